"""`s2r run import`: what it prints, and requests that are wrong."""

import hashlib
import json
from pathlib import Path

import pytest

import s2rstore
from s2rtui.cli import main
from tests.support.predictions import make, write_csv, write_rows

NAMES = ("iid", "side", "x", "y", "heading")


@pytest.fixture
def predictions(store_copy: Path, tmp_path: Path) -> Path:
    return write_csv(tmp_path / "p.csv", make(store_copy))


def run_import(store: Path, *words: object) -> int:
    return main(["run", "import", "theirs", *map(str, words), "--store", str(store)])


def test_it_says_how_files_were_read_and_keeps_command_and_files(store_copy, predictions, capsys):
    assert run_import(store_copy, "--predictions", predictions) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("p.csv: 80 predictions in 80 rows, matched by iid; positions in m ")
    assert "run theirs imported: 40 of 40 instances on both sides (sim 40, real 40)" in second
    assert second.endswith(f"next: `s2r precompute {store_copy} --run theirs`")
    assert run_import(store_copy, "--predictions", predictions) == 0
    assert "run theirs replaced: 40 of 40" in capsys.readouterr().out
    with s2rstore.open(store_copy) as store:
        facts = store.provenance("run:theirs")
    counts = {"sim": 40, "real": 40, "both": 40, "store": 40, "attempted": 40,
                  "not_localised": 0, "absent": 0}  # fmt: skip
    assert json.loads(facts["imported instances"]) == counts
    (file,) = json.loads(facts["imported predictions"])
    assert file["sha256"] == hashlib.sha256(predictions.read_bytes()).hexdigest()
    names = ("file", "length", "angle", "heading")
    assert [file[name] for name in names] == ["p.csv", "m", "rad", "0+h"]
    assert facts["command"].split()[0] == "s2r"


def test_issues_and_warnings_go_to_standard_error(store_copy, tmp_path, capsys):
    made = make(store_copy)
    rows = [(iid, side, x, y, heading + 1.6) for side in ("sim", "real")
            for iid, (x, y, heading) in enumerate(made.of(side))]  # fmt: skip
    rows.append((77, "sim", 1.0, 2.0, 3.0))
    file = write_rows(tmp_path / "p.csv", NAMES, rows)
    assert run_import(store_copy, "--predictions", file, "--units", "m,rad") == 0
    lines = capsys.readouterr().err.splitlines()
    assert lines[:2] == ["unmatched row: 1", "  p.csv:82 iid 77: the store holds 0 .. 39"]
    assert lines[2].startswith(f"warning: {file}: the median heading error is ")
    assert "with --heading 270+h it would be" in lines[2]
    assert run_import(store_copy, "--predictions", file, "--heading", "auto") == 0
    captured = capsys.readouterr()
    assert "map heading 270+h" in captured.out
    assert "warning" not in captured.err


@pytest.mark.parametrize(("words", "message"), [
    (("--units", "inches"), "--units inches: one of m, cm, mm"),
    (("--heading", "north"), "--heading north: one of 0+h"),
    (("--tolerance", "-1"), "--tolerance -1: must be above 0 seconds"),
    (("--real", "sim"), "--real sim: no real domain (has: real)"),
    (("--embeddings", "none.npy"), "none.npy"),
])  # fmt: skip
def test_wrong_requests_end_in_one_line(store_copy, predictions, words, message, capsys):
    assert run_import(store_copy, "--predictions", predictions, *words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
    with s2rstore.open(store_copy) as store:
        assert "theirs" not in store.runs
