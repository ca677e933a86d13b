"""The snapshot command: keys by name and by character."""

from __future__ import annotations

from pathlib import Path

from s2rtui.app.pilot import is_key
from s2rtui.cli import main
from s2rtui.user_data.notebook import Notebook, SavedSelection


def screen(store: Path, folder: Path, keys: str, size: str = "80x24") -> str:
    out = folder / "screen.txt"
    assert main(["snapshot", str(store), "--size", size, f"--keys={keys}", "--out", str(out)]) == 0
    return out.read_text()


def test_keys_can_be_named_or_written_as_characters(tiny_store: Path, tmp_path: Path) -> None:
    names = ("ampersand", "vertical_line", "exclamation_mark", "minus", "slash", "question_mark",
             "at", "number_sign", "full_stop", "plus")  # fmt: skip
    for name, character in zip(names, "&|!-/?@#.+", strict=True):
        assert is_key(name)
        assert is_key(character)
    plain = screen(tiny_store, tmp_path, "c,8")
    for name, character in (("full_stop", "."), ("question_mark", "?")):
        shown = screen(tiny_store, tmp_path, f"c,8,{name}")
        assert shown == screen(tiny_store, tmp_path, f"c,8,{character}") != plain


def test_operators_combine_selections(tiny_store: Path, tmp_path: Path) -> None:
    assert "worst(15%, sim.error) & best15" in screen(tiny_store, tmp_path, "W,&,b", "160x24")
    keys = "w,vertical_line,b,!"
    assert "!(worst15 | best15)" in screen(tiny_store, tmp_path, keys, "160x24")


def test_a_snapshot_shows_the_notebook_without_changing_it(
    tiny_store: Path, tmp_path: Path
) -> None:
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
