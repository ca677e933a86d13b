"""`s2r ingest --append` on the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

import s2rstore
from s2rtui.cli import main
from tests.support import pairs
from tests.support.predictions import make, write_csv

SIZE = ("--size", "32")


@pytest.fixture
def source(tmp_path: Path) -> tuple[str, ...]:
    header = pairs.sim2realviz(tmp_path / "data", n=4, trajectories=("a", "b"))
    return "sim2realviz", str(tmp_path / "data"), "--calibration", str(header)


def test_a_trajectory_is_added_in_the_frame_size_of_the_store(
    source: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = str(tmp_path / "s.s2r")
    assert main(["ingest", *source, "--store", store, *SIZE, "--trajectory", "b"]) == 0
    capsys.readouterr()
    assert main(["ingest", *source, "--store", store, "--append"]) == 0
    output = capsys.readouterr()
    assert output.out == f"{store}: 4 instances added, now 8; trajectories a (4)\n"
    assert "trajectory b: already in the store\n" in output.err
    with s2rstore.open(store) as opened:
        assert '"trajectories":{"a":4}' in opened.provenance("dataset")["append:1"]
    assert main(["ingest", *source, "--store", store, "--append"]) == 0
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("already in the store") == 2
    assert output.err.count("no new instances or domains; nothing to append") == 1
    assert main(["verify", store]) == 0


def test_refusals_are_one_line(
    source: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = str(tmp_path / "s.s2r")
    assert main(["ingest", *source, "--store", store, "--append"]) == 2
    assert "leave out --append" in capsys.readouterr().err.splitlines()[-1]
    assert not Path(store).exists()
    assert main(["ingest", *source, "--store", store, *SIZE]) == 0
    capsys.readouterr()
    assert main(["ingest", *source, "--store", store, *SIZE]) == 2
    assert "--append" in capsys.readouterr().err
    assert main(["ingest", *source, "--store", store, "--append", "--size", "48"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "another frame size (--size): 48x48, the store 32x32" in line


def test_runs_of_imported_predictions_are_to_be_imported_again(
    source: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = str(tmp_path / "s.s2r")
    assert main(["ingest", *source, "--store", store, *SIZE, "--trajectory", "b"]) == 0
    file = write_csv(tmp_path / "p.csv", make(Path(store)))
    assert main(["run", "import", "theirs", "--predictions", str(file), "--store", store]) == 0
    capsys.readouterr()
    assert main(["ingest", *source, "--store", store, "--append"]) == 0
    output = capsys.readouterr().out
    assert "import the predictions of theirs again (`s2r run import`)" in output
    assert "s2r precompute" not in output
