"""`s2r rooms`: list and rename rooms."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import pytest

import s2rstore
from s2rstore.maintenance.verify import verify
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtui.cli import main
from tests.support.silent_reporter import SilentReporter

pytestmark = pytest.mark.xdist_group("computed")


@pytest.fixture(scope="module")
def computed_rooms(trained_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rooms") / "s.s2r"
    shutil.copytree(trained_store, path)
    precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(()))
    return path


def names(path: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, int]:
    assert main(["rooms", str(path), "--format", "csv"]) == 0
    rows = csv.DictReader(capsys.readouterr().out.splitlines())
    return {row["room"]: int(row["instances"]) for row in rows}


def test_renaming_a_room_computes_nothing_again(
    computed_rooms: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.s2r"
    shutil.copytree(computed_rooms, path)
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


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("nowhere", "x", "room 'nowhere': not in"),
        (None, None, "exists already"),
        (None, "", "printable"),
        (None, " x ", "blanks"),
        (None, "no room", "outside all rooms"),
        (None, "a\x1b[2J", "printable"),
        (None, "n" * 1001, "1 to 1000"),
    ],
)
def test_names_that_cannot_be_given_are_refused(
    computed_rooms: Path,
    capsys: pytest.CaptureFixture[str],
    old: str | None,
    new: str | None,
    message: str,
) -> None:
    known = list(names(computed_rooms, capsys))
    chosen = known[0] if old is None else old
    assert (
        main(["rooms", str(computed_rooms), "--rename", chosen, known[-1] if new is None else new])
        == 2
    )
    assert message in capsys.readouterr().err
    assert list(names(computed_rooms, capsys)) == known
