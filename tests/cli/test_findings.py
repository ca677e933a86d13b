"""`s2r findings`: JSON that agrees with `s2r query`, a table of 80 columns, and refusals."""

import json
from pathlib import Path

import pytest

from s2rstore.index.transaction import edit
from s2rtui.cli import main
from tests.support import image_folders, tiny


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Vanilla was trained on four of five instances."""
    path = tmp_path_factory.mktemp("findings") / "s.s2r"
    return tiny.build(path, n=80, trained=("vanilla",))


@pytest.mark.parametrize("run", ["vanilla", "dataaug"])
def test_a_query_of_the_expression_gives_the_same_count(store, run, capsys):
    assert main(["findings", str(store), "--run", run, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["run"] == run
    assert report["findings"]
    for finding in report["findings"]:
        if finding["expression"] is None:
            continue
        arguments = ["query", str(store), finding["expression"], "--run", finding["run"]]
        assert main([*arguments, "--count"]) == 0
        assert int(capsys.readouterr().out) == finding["n"]
        assert main([*arguments, "--json"]) == 0
        assert len(json.loads(capsys.readouterr().out)) == finding["n"]


def test_the_table_fits_into_80_columns(store, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["findings", str(store)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    assert "worst room" in text
    assert "select: " in text
    assert all(line == line.rstrip() for line in lines)


def test_unknown_runs_and_histories_are_rejected(store, tmp_path, capsys):
    assert main(["findings", str(store), "--run", "nobody"]) == 2
    assert "nobody" in capsys.readouterr().err
    assert main(["findings", str(store), "--history", str(tmp_path / "no.jsonl")]) == 2
    assert "no.jsonl" in capsys.readouterr().err
    path = tmp_path / "gap.jsonl"
    path.write_text("no history")
    assert main(["findings", str(store), "--history", str(path)]) == 2
    assert "no history that this version reads" in capsys.readouterr().err


def test_stores_without_poses_or_computed_runs_are_rejected(tmp_path, capsys):
    path = image_folders.image_store(tmp_path)
    capsys.readouterr()
    assert main(["findings", str(path)]) == 2
    assert "needs poses" in capsys.readouterr().err
    path = tiny.build(tmp_path / "s.s2r", n=16, runs=("vanilla",))
    with edit(path) as draft:
        draft.rows("UPDATE run SET key = NULL")
    assert main(["findings", str(path)]) == 2
    assert "s2r precompute" in capsys.readouterr().err


@pytest.mark.parametrize("grouping", ["room", "heading", "curvature", "trajectory"])
def test_shown_groups_count_the_new_instances(store, grouping, capsys):
    arguments = ["show", str(store), "rooms", "--group-by", grouping, "--sort", "n", "--json"]
    assert main(arguments) == 0
    rows = json.loads(capsys.readouterr().out)
    assert sum(row["n"] for row in rows) == 16
    assert sum(row["selected"] for row in rows) == 16
    assert [row["n"] for row in rows] == sorted((row["n"] for row in rows), reverse=True)
    for row in rows:
        assert row["low_m"] is None or row["low_m"] <= row["real_m"] <= row["high_m"]


@pytest.mark.parametrize(
    ("view", "column", "listed"), [("list", "real_m", "real.error"), ("rooms", "gap", "gap_m"),
                                   ("list", "", "gap"), ("rooms", "iid", "group")],
)  # fmt: skip
def test_a_column_that_the_view_does_not_have_is_rejected(store, view, column, listed, capsys):
    assert main(["show", str(store), view, "--sort", column]) == 2
    assert listed in capsys.readouterr().err


def test_sentences_keep_the_names_of_runs(tmp_path, capsys):
    runs = ("NetA", "NetB")
    path = tiny.build(tmp_path / "s.s2r", 12, runs, trained=runs)
    for view in ("findings", "map"):
        assert main(["show", str(path), view, "--run", "NetA", "--words"]) == 0
        printed = capsys.readouterr().out
        assert printed[0].isupper() or printed[0].isdigit()
        assert "neta" not in printed
        assert view != "findings" or "NetA" in printed
