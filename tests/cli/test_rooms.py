"""`s2r rooms`: list and rename rooms."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

import s2rstore
from s2rstore.maintenance.verify import verify
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtui.cli import main
from tests.support.copies import copy_store
from tests.support.silent_reporter import SilentReporter


def names(path: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, int]:
    assert main(["rooms", str(path), "--format", "csv"]) == 0
    rows = csv.DictReader(capsys.readouterr().out.splitlines())
    return {row["room"]: int(row["instances"]) for row in rows}


def test_renaming_a_room_computes_nothing_again(
    few_pairs_store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = copy_store(few_pairs_store, tmp_path / "s.s2r")
    before = names(path, capsys)
    old = max(before, key=lambda name: before[name])
    assert before[old] > 0
    with s2rstore.open(path) as store:
        generation = store.generation
    assert main(["rooms", str(path), "--rename", old, "tea kitchen"]) == 0
    assert f"room {old} is now tea kitchen ({before[old]} instances)" in capsys.readouterr().out
    after = names(path, capsys)
    assert after == {("tea kitchen" if name == old else name): n for name, n in before.items()}
    with s2rstore.open(path) as store:
        assert store.generation == generation + 1
    assert precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(())) == []
    expression = ['room:"tea kitchen"', "--with-trained"]
    assert main(["query", str(path), *expression, "--format", "csv"]) == 0
    assert len(capsys.readouterr().out.splitlines()) > 1
    assert verify(path) == []


def test_names_that_cannot_be_given_are_refused(
    few_pairs_store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    known = list(names(few_pairs_store, capsys))
    for old, new, message in (
        ("nowhere", "x", "room 'nowhere': not in"),
        (known[0], known[-1], "exists already"),
        (known[0], "", "printable"),
        (known[0], " x ", "blanks"),
        (known[0], "no room", "outside all rooms"),
        (known[0], "a\x1b[2J", "printable"),
        (known[0], "n" * 1001, "1 to 1000"),
    ):
        assert main(["rooms", str(few_pairs_store), "--rename", old, new]) == 2, new
        assert message in capsys.readouterr().err
    assert list(names(few_pairs_store, capsys)) == known
