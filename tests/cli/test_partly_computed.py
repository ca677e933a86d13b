"""Commands say once that a run is not computed for appended instances."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import s2rstore
from s2rtui.cli import main
from tests.support.appended import append_trajectory

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


def test_one_line_on_standard_error(
    appended: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in COMMANDS:
        filled = [word.format(store=appended, out=tmp_path / "out") for word in words]
        assert main(filled) in (0, 3), words
        assert capsys.readouterr().err.splitlines().count(NOTE) == 1, words


def test_nothing_is_said_of_a_run_that_is_computed_for_all(
    store_copy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in COMMANDS[:4]:
        assert main([word.format(store=store_copy) for word in words]) == 0
        assert "computed for" not in capsys.readouterr().err


def test_json_objects_and_reports_hold_the_note(
    appended: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["query", str(appended), "all", "--json", "--with-expression"]) == 0
    assert json.loads(capsys.readouterr().out)["note"] == NOTE
    assert main(["gap", str(appended), "--axis", "task", "--json"]) in (0, 3)
    assert json.loads(capsys.readouterr().out)["note"] == NOTE
    assert main(["runs", str(appended), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["note"] in NOTE
    page = tmp_path / "report.html"
    assert main(["report", str(appended), "--select", "none", "--out", str(page)]) == 0
    assert page.read_text().count("computed for 40 of 45 instances") == 2  # once for either run


def test_heat_of_an_instance_that_is_not_computed(
    appended: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["show", str(appended), "instance", "--iid", "42", "--words"]) == 0
    assert capsys.readouterr().out.endswith("not predicted.\n")
    assert main(["show", str(appended), "instance", "--iid", "42"]) == 0
    expected = (
        "instance 42: feature_distance of run 'vanilla' is not computed; run `s2r precompute`"
    )
    assert expected in capsys.readouterr().out


def test_coverage_counts_instances_of_the_named_run(appended: Path) -> None:
    with s2rstore.open(appended) as store:
        coverage = store.coverage("vanilla")
        assert (coverage.computed, coverage.instances, coverage.is_partial) == (40, 45, True)
        assert coverage.note == NOTE
        assert store.coverage("dataaug").note == NOTE.replace("vanilla", "dataaug")
