"""Every view at every size, as text, against the screens that were looked at.

`S2R_UPDATE_SCREENS=1 pytest tests/app/test_screen_snapshots.py` writes them again; check the diff.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest

from s2rstore.reader import Store
from s2rtui.app.pilot import snapshot
from s2rtui.canvas import RenderOptions
from s2rtui.charts.instance.model import instance_input
from s2rtui.charts.registry import VIEWS
from s2rtui.loaders.live_prediction import LivePredictor
from s2rtui.terminal import diagnostics
from s2rtui.terminal.diagnostics import PARTS

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
    shot = snapshot(tiny_store, size, ["w", *KEYS[name]], RenderOptions())
    check(f"{name}-{size[0]}x{size[1]}", shot.text)


@pytest.mark.parametrize("name", KEYS)
def test_ascii_screen(tiny_store: Path, name: str) -> None:
    shot = snapshot(tiny_store, (80, 24), ["w", *KEYS[name]], RenderOptions(ascii=True))
    assert shot.text.isascii()
    check(f"{name}-ascii", shot.text)


@dataclass
class Still:
    """In place of a live model: what is stored, whatever the sliders say."""

    store: Store
    run: str
    kinds: tuple[str, ...] = ()

    def steps(self, iid: int, *_: object) -> Iterator[SimpleNamespace]:
        shown = instance_input(self.store, self.run, iid, None)
        sides = {}
        for name, side in (("sim", shown.sim), ("real", shown.real)):
            pose = side.pose
            assert pose is not None
            sides[name] = SimpleNamespace(
                rgb=side.rgb, depth=side.depth, x=pose.x, y=pose.y, heading=pose.heading,
                error=pose.error, heading_error=pose.heading_error,
            )  # fmt: skip
        yield SimpleNamespace(iid=iid, side=sides.__getitem__)


OUTSIDE = {"adjust": ("a", "right", "right", "down"), "doctor": ("D",)}
"""Keys to what shows more than the store: a model, the terminal, what is installed."""


@pytest.fixture
def still(monkeypatch: pytest.MonkeyPatch) -> None:
    """A model that never moves, on a plain terminal, everything installed."""
    monkeypatch.setattr(LivePredictor, "model", lambda _, store, run: Still(store, run))
    monkeypatch.setattr(diagnostics, "packages", lambda: [(part, "installed") for part in PARTS])
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("LC_ALL", "C.UTF-8")
    for name in ("COLORTERM", "NO_COLOR", "SSH_CONNECTION", "TMUX"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.usefixtures("still")
@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
@pytest.mark.parametrize("name", OUTSIDE)
def test_screen_of_more_than_the_store(tiny_store: Path, name: str, size: tuple[int, int]) -> None:
    shot = snapshot(tiny_store, size, ["w", *OUTSIDE[name]], RenderOptions())
    check(f"{name}-{size[0]}x{size[1]}", shot.text)


@pytest.mark.usefixtures("still")
@pytest.mark.parametrize("name", OUTSIDE)
def test_ascii_screen_of_more_than_the_store(tiny_store: Path, name: str) -> None:
    shot = snapshot(tiny_store, (80, 24), ["w", *OUTSIDE[name]], RenderOptions(ascii=True))
    assert shot.text.isascii()
    check(f"{name}-ascii", shot.text)


def check(name: str, text: str) -> None:
    path = SCREENS / f"{name}.txt"
    if os.environ.get("S2R_UPDATE_SCREENS"):
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    assert text == path.read_text(encoding="utf-8"), f"{path.name} has changed"
