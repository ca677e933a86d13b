"""The snapshot command: keys by name and by character."""

from __future__ import annotations

from pathlib import Path

import pytest

from s2rtui.cli import main
from s2rtui.user_data.notebook import Notebook, SavedSelection


def screen(store: Path, folder: Path, keys: str, size: str = "120x40") -> str:
    out = folder / "screen.txt"
    assert main(["snapshot", str(store), "--size", size, f"--keys={keys}", "--out", str(out)]) == 0
    return out.read_text()


@pytest.mark.parametrize(
    ("name", "character"),
    [
        ("ampersand", "&"), ("vertical_line", "|"), ("exclamation_mark", "!"), ("minus", "-"),
        ("slash", "/"), ("question_mark", "?"), ("at", "@"), ("number_sign", "#"),
        ("full_stop", "."), ("plus", "+"),
    ],
)  # fmt: skip
def test_a_key_can_be_named_or_written_as_a_character(
    tiny_store: Path, tmp_path: Path, name: str, character: str
) -> None:
    keys = f"c,8,{name}"
    assert screen(tiny_store, tmp_path, keys) == screen(tiny_store, tmp_path, f"c,8,{character}")


def test_operators_combine_selections(tiny_store: Path, tmp_path: Path) -> None:
    assert "worst(15%, sim.error) & best15" in screen(tiny_store, tmp_path, "W,&,b", "160x44")
    assert "worst15 | best15" in screen(tiny_store, tmp_path, "w,vertical_line,b", "160x44")
    assert "!worst15" in screen(tiny_store, tmp_path, "w,!", "160x44")


def test_space_opens_the_jump_screen(tiny_store: Path, tmp_path: Path) -> None:
    plain = screen(tiny_store, tmp_path, "c")
    assert screen(tiny_store, tmp_path, "c,space") != plain


def test_letters_are_typed_into_the_query_line(tiny_store: Path, tmp_path: Path) -> None:
    typed = "slash,home,ctrl+k,g,a,p,space,>,space,1,enter"
    assert "gap > 1" in screen(tiny_store, tmp_path, typed, "160x44")


def test_a_snapshot_shows_the_notebook_without_changing_it(
    tiny_store: Path, tmp_path: Path
) -> None:
    notebook = Notebook("0" * 64)
    notebook.save("mine", SavedSelection("worst15", 1, "vanilla", 6))
    notebook.note(3, "glare on the floor")
    before = notebook.path.read_bytes()
    shown = screen(tiny_store, tmp_path, "slash,home,ctrl+k,@,m,i,n,e,enter,8", "160x44")
    assert "@mine" in shown
    keys = "slash,home,ctrl+k,i,d,s,(,3,),enter,8"
    assert "glare" in screen(tiny_store, tmp_path, keys, "80x24")
    screen(tiny_store, tmp_path, "w,@,x,enter")
    assert notebook.path.read_bytes() == before
