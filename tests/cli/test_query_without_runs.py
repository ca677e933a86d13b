"""`s2r query` on a store with poses in which no run is computed."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from s2rtui.cli import main
from tests.support import pairs


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """12 pairs in two rooms; no test modifies it."""
    root = tmp_path_factory.mktemp("unpredicted")
    path, manifest = root / "s.s2r", pairs.manifest(root / "data")
    assert main(["ingest", "csv", str(manifest), "--store", str(path), "--size", "16"]) == 0
    return path


def test_expressions_of_the_ground_truth_work(
    store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert main(["query", str(store), "all", "--format", "csv", "--column-names", "new"]) == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    assert len(rows) == 12
    assert list(rows[0]) == ["iid", "trajectory", "seq", "x_m", "y_m", "heading_deg", "room"]
    expected = [row["iid"] for row in rows if row["room"] == "west" and row["trajectory"] == "a"]
    command = ["query", str(store), "room:west & traj:a & x < 100 & (straight | curved)"]
    assert main([*command, "--columns", "iid,x,tags", "--format", "csv"]) == 0
    found = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    assert expected
    assert [row["iid"] for row in found] == expected
    assert main([*command, "--count"]) == 0
    assert capsys.readouterr().out.strip() == str(len(expected))


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        (["worst15"], "real.error"),
        (["x > 1 & sim.error > 2"], "sim.error"),
        (["like(3, 2)"], "like"),
        (["sim.room:west"], "sim.room"),
        (["all", "--columns", "iid,gap"], "--columns gap"),
        (["all", "--columns", "iid,real.room"], "--columns real.room"),
    ],
)
def test_fields_of_predictions_need_a_run(
    store: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], field: str
) -> None:
    assert main(["query", str(store), *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{field}" in line
    assert "needs predictions: no run; train a model (`s2r train`)" in line
    assert "`s2r run import`" in line


def test_precompute_and_unknown_runs_name_both_ways(
    store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["precompute", str(store)]) == 2
    assert "`s2r run import`" in capsys.readouterr().err
    assert main(["query", str(store), "all", "--run", "mine"]) == 2
    assert "run 'mine': not in" in capsys.readouterr().err
