"""Screens of the application in tests of your own, such as those of a view that a plug-in adds."""

from __future__ import annotations

import difflib
import os
from collections.abc import Sequence
from pathlib import Path

UPDATE = "S2R_UPDATE_SCREENS"
"""Environment variable that makes `assert_screen` write the stored screens."""


def screen(
    store: str | Path, keys: Sequence[str] = (), size: tuple[int, int] = (120, 40),
    run: str | None = None, ascii_only: bool = False,
) -> str:  # fmt: skip
    """The text of the application's screen on a store after some keys, with all data loaded.

    size: columns and rows. keys: characters, or Textual's names of keys. The notebook of the user
    is read and not changed. Raises RequestError where the store cannot be opened.
    """
    from s2rtui.app.pilot import snapshot
    from s2rtui.canvas import RenderOptions

    options = RenderOptions(ascii=ascii_only)
    return snapshot(Path(store), size, keys, options, run=run).text


def assert_screen(path: str | Path, text: str) -> None:
    """Compare the text of a screen with the one that is stored at `path`.

    Raises AssertionError with the lines that differ, and where nothing is stored. With
    `S2R_UPDATE_SCREENS=1` in the environment, the text is stored instead: look at the difference
    before you keep it.
    """
    path = Path(path)
    if os.environ.get(UPDATE):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    if not path.is_file():
        raise AssertionError(f"{path} does not exist; {UPDATE}=1 stores the screen")
    stored = path.read_text(encoding="utf-8")
    if text != stored:
        lines = difflib.unified_diff(
            stored.splitlines(), text.splitlines(), str(path), "screen", lineterm="", n=1
        )
        raise AssertionError("\n".join([f"{path.name} has changed", *lines]))
