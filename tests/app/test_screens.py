"""Every view at every size, as text, against the screens that were looked at.

`S2R_UPDATE_SCREENS=1 pytest tests/app/test_screens.py` writes them anew: look at the difference.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from s2rtui.canvas import Look
from s2rtui.headless import snapshot
from s2rtui.views import VIEWS

SCREENS = Path(__file__).parent / "screens"
SIZES = ((80, 24), (120, 40), (200, 60))
KEYS = {view.name: (view.key,) for view in VIEWS if view.name != "adjust"}
KEYS |= {
    "map-full": ("m", "m"),
    "map-glyph": ("m",),
    "map-heat": ("o", "o", "C"),
    "map-brush": ("x", "Z"),
    "umap-brush": ("4", "x"),
    "orientation-brush": ("5", "x"),
    "rooms-brush": ("6", "x", "shift+down"),
    "errors-brush": ("7", "x"),
    "help": ("question_mark",),
    "tour": ("T",),
    "jump": ("space",),
    "selections": ("b", "f"),
    "query": ("slash",),
}


@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
@pytest.mark.parametrize("name", KEYS)
def test_screen(tiny_store: Path, name: str, size: tuple[int, int]) -> None:
    shot = snapshot(tiny_store, size, ["w", *KEYS[name]], Look())
    check(f"{name}-{size[0]}x{size[1]}", shot.text)


@pytest.mark.parametrize("name", KEYS)
def test_ascii_screen(tiny_store: Path, name: str) -> None:
    shot = snapshot(tiny_store, (80, 24), ["w", *KEYS[name]], Look(ascii=True))
    assert shot.text.isascii()
    check(f"{name}-ascii", shot.text)


def check(name: str, text: str) -> None:
    path = SCREENS / f"{name}.txt"
    if os.environ.get("S2R_UPDATE_SCREENS"):
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    assert text == path.read_text(encoding="utf-8"), f"{path.name} has changed"
