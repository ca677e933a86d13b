"""`s2r ingest --append`, and the note that a run is not computed for appended instances."""

import json
from pathlib import Path

import pytest

import s2rstore
from s2rtui.cli import main
from tests.support import pairs
from tests.support.appended import append_trajectory
from tests.support.predictions import make, write_csv

SIZE = ("--size", "32")


@pytest.fixture
def source(tmp_path: Path) -> tuple[str, ...]:
    header = pairs.sim2realviz(tmp_path / "data", n=4, trajectories=("a", "b"))
    return "sim2realviz", str(tmp_path / "data"), "--calibration", str(header)


def test_a_trajectory_is_added_in_the_frame_size_of_the_store(source, tmp_path, s2r):
    store = str(tmp_path / "s.s2r")
    assert main(["ingest", *source, "--store", store, *SIZE, "--trajectory", "b"]) == 0
    output = s2r("ingest", *source, "--store", store, "--append").checked()
    assert output.out == f"{store}: 4 instances added, now 8; trajectories a (4)\n"
    assert "trajectory b: already in the store\n" in output.err
    with s2rstore.open(store) as opened:
        assert '"trajectories":{"a":4}' in opened.provenance("dataset")["append:1"]
    output = s2r("ingest", *source, "--store", store, "--append").checked()
    assert output.out == ""
    assert output.err.count("already in the store") == 2
    assert output.err.count("no new instances or domains; nothing to append") == 1
    assert main(["verify", store]) == 0


def test_refusals_are_one_line(source, tmp_path, s2r):
    store = str(tmp_path / "s.s2r")
    assert (
        "leave out --append"
        in s2r("ingest", *source, "--store", store, "--append").checked(2).err.splitlines()[-1]
    )
    assert not Path(store).exists()
    assert main(["ingest", *source, "--store", store, *SIZE]) == 0
    s2r("ingest", *source, "--store", store, *SIZE).assert_refused("--append")
    s2r("ingest", *source, "--store", store, "--append", "--size", "48").assert_refused(
        "another frame size (--size): 48x48, the store 32x32"
    )


def test_runs_of_imported_predictions_are_to_be_imported_again(source, tmp_path, s2r):
    store = str(tmp_path / "s.s2r")
    assert main(["ingest", *source, "--store", store, *SIZE, "--trajectory", "b"]) == 0
    file = write_csv(tmp_path / "p.csv", make(Path(store)))
    assert main(["run", "import", "theirs", "--predictions", str(file), "--store", store]) == 0
    output = s2r("ingest", *source, "--store", store, "--append").printed
    assert "import the predictions of theirs again (`s2r run import`)" in output
    assert "s2r precompute" not in output


NOTE = "run vanilla: computed for 40 of 45 instances; `s2r precompute` computes the others"
COMMANDS = (
    ("query", "{store}", "all"),
    ("query", "{store}", "all", "--count"),
    ("query", "{store}", "all", "--json"),
    ("show", "{store}", "rooms"),
    ("show", "{store}", "map", "--words"),
    ("export", "{store}", "--view", "errors", "--out", "{out}.svg", "--size", "300x200"),
    ("export", "{store}", "--view", "workbench", "--out", "{out}.png", "--size", "400x300"),
    ("report", "{store}", "--run", "vanilla", "--select", "none", "--out", "{out}.html"),
    ("gap", "{store}", "--axis", "task"),
)


@pytest.fixture
def appended(store_copy: Path) -> Path:
    append_trajectory(store_copy, "a0", 5)
    return store_copy


def test_one_line_on_standard_error(appended, tmp_path, capsys):
    for words in COMMANDS:
        filled = [word.format(store=appended, out=tmp_path / "out") for word in words]
        assert main(filled) in (0, 3), words
        assert capsys.readouterr().err.splitlines().count(NOTE) == 1, words


def test_json_objects_and_reports_hold_the_note(appended, tmp_path, capsys, s2r):
    assert s2r("query", appended, "all", "--json", "--with-expression").json["note"] == NOTE
    assert main(["gap", str(appended), "--axis", "task", "--json"]) in (0, 3)
    assert json.loads(capsys.readouterr().out)["note"] == NOTE
    assert s2r("runs", appended, "--json").json[0]["note"] in NOTE
    page = tmp_path / "report.html"
    assert main(["report", str(appended), "--select", "none", "--out", str(page)]) == 0
    assert page.read_text().count("computed for 40 of 45 instances") == 2  # once for either run


def test_heat_of_an_instance_that_is_not_computed(appended, capsys, s2r):
    assert s2r("show", appended, "instance", "--iid", "42", "--words").printed.endswith(
        "not predicted.\n"
    )
    assert main(["show", str(appended), "instance", "--iid", "42"]) == 0
    text = "instance 42: feature_distance of run 'vanilla' is not computed; run `s2r precompute`"
    assert text in capsys.readouterr().out
