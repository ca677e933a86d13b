"""`s2r rooms` lists and renames rooms; `s2r snapshot` takes keys by name and character."""

from pathlib import Path

import s2rstore
from s2rstore.maintenance.verify import verify
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtui.app.pilot import is_key
from s2rtui.cli import main
from s2rtui.user_data.notebook import Notebook, SavedSelection
from tests.support.copies import copy_store
from tests.support.refusals import RunCommand
from tests.support.silent_reporter import SilentReporter


def names(path: Path, s2r: RunCommand) -> dict[str, int]:
    rows = s2r("rooms", path, "--format", "csv").rows
    return {row["room"]: int(row["instances"]) for row in rows}


def test_renaming_a_room_computes_nothing_again(few_pairs_store, tmp_path, s2r):
    path = copy_store(few_pairs_store, tmp_path / "s.s2r")
    before = names(path, s2r)
    old = max(before, key=lambda name: before[name])
    assert before[old] > 0
    with s2rstore.open(path) as store:
        generation = store.generation
    assert (
        f"room {old} is now tea kitchen ({before[old]} instances)"
        in s2r("rooms", path, "--rename", old, "tea kitchen").printed
    )
    after = names(path, s2r)
    assert after == {("tea kitchen" if name == old else name): n for name, n in before.items()}
    with s2rstore.open(path) as store:
        assert store.generation == generation + 1
    assert precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(())) == []
    expression = ['room:"tea kitchen"', "--with-trained"]
    assert len(s2r("query", path, *expression, "--format", "csv").lines) > 1
    assert verify(path) == []


def test_names_that_cannot_be_given_are_refused(few_pairs_store, s2r):
    known = list(names(few_pairs_store, s2r))
    for old, new, message in (
        ("nowhere", "x", "room 'nowhere': not in"),
        (known[0], known[-1], "exists already"),
        (known[0], "", "printable"),
        (known[0], " x ", "blanks"),
        (known[0], "no room", "outside all rooms"),
        (known[0], "a\x1b[2J", "printable"),
        (known[0], "n" * 1001, "1 to 1000"),
    ):
        s2r("rooms", few_pairs_store, "--rename", old, new).assert_refused(message)
    assert list(names(few_pairs_store, s2r)) == known


def screen(store: Path, folder: Path, keys: str, size: str = "80x24") -> str:
    out = folder / "screen.txt"
    assert main(["snapshot", str(store), "--size", size, f"--keys={keys}", "--out", str(out)]) == 0
    return out.read_text()


def test_keys_can_be_named_or_written_as_characters(tiny_store, tmp_path):
    names = ("ampersand", "vertical_line", "exclamation_mark", "minus", "slash", "question_mark",
             "at", "number_sign", "full_stop", "plus")  # fmt: skip
    for name, character in zip(names, "&|!-/?@#.+", strict=True):
        assert is_key(name)
        assert is_key(character)
    shown = screen(tiny_store, tmp_path, "c,8,question_mark")
    assert shown == screen(tiny_store, tmp_path, "c,8,?")
    assert "Where is it worst?" in shown
    shown = screen(tiny_store, tmp_path, "W,&,b,vertical_line,w,!", "160x24")
    assert "!(worst(15%, sim.error) & best15 | worst15)" in shown


def test_a_snapshot_shows_the_notebook_without_changing_it(tiny_store, tmp_path):
    notebook = Notebook("0" * 64)
    notebook.save("mine", SavedSelection("worst15", 1, "vanilla", 6))
    notebook.note(3, "glare on the floor")
    before = notebook.path.read_bytes()
    shown = screen(tiny_store, tmp_path, "slash,home,ctrl+k,@,m,i,n,e,enter,8", "160x24")
    assert "@mine" in shown
    keys = "slash,home,ctrl+k,i,d,s,(,3,),enter,8"
    assert "glare" in screen(tiny_store, tmp_path, keys, "80x24")
    screen(tiny_store, tmp_path, "w,@,x,enter")
    assert notebook.path.read_bytes() == before
