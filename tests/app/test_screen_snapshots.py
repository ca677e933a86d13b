"""Every view at every size compared with stored text screens.

`S2R_UPDATE_SCREENS=1 pytest tests/app/test_screen_snapshots.py` rewrites them; check the diff.
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
from tests.support import tiny

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
    "scatter-brush": ("X", "x"),
    "help": ("question_mark",),
    "tour": ("T",),
    "jump": ("space",),
    "selections": ("b", "f"),
    "query": ("slash",),
}


@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
@pytest.mark.parametrize("name", KEYS)
def test_screen(tiny_store: Path, name: str, size: tuple[int, int]) -> None:
    screenshot = snapshot(tiny_store, size, ["w", *KEYS[name]], RenderOptions())
    check(f"{name}-{size[0]}x{size[1]}", screenshot.text)


@pytest.mark.parametrize("name", KEYS)
def test_ascii_screen(tiny_store: Path, name: str) -> None:
    screenshot = snapshot(tiny_store, (80, 24), ["w", *KEYS[name]], RenderOptions(ascii=True))
    assert screenshot.text.isascii()
    check(f"{name}-ascii", screenshot.text)


@pytest.mark.parametrize("keys", ["c", "c,M", "c,M,9"])
def test_screen_of_a_run_with_trained_instances(tmp_path: Path, keys: str) -> None:
    store = tiny.build(tmp_path / "half.s2r", trained=("vanilla",))
    screenshot = snapshot(store, (120, 40), keys.split(","), RenderOptions())
    check(f"trained-{keys.replace(',', '')}-120x40", screenshot.text)


@dataclass
class StoredPredictor:
    """Replaces the live model: returns the stored prediction for all slider values."""

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
                error=pose.error, heading_error=pose.heading_error, original=None,
            )  # fmt: skip
        yield SimpleNamespace(iid=iid, side=sides.__getitem__)


ENVIRONMENT_KEYS = {"adjust": ("a", "right", "right", "down"), "doctor": ("D",)}
"""Keys that open views of more than the store: the model, the terminal, installed packages."""


@pytest.fixture
def fixed_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stored prediction, a plain terminal and all packages installed."""
    monkeypatch.setattr(LivePredictor, "model", lambda _, store, run: StoredPredictor(store, run))
    monkeypatch.setattr(diagnostics, "packages", lambda: [(part, "installed") for part in PARTS])
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("LC_ALL", "C.UTF-8")
    for name in ("COLORTERM", "NO_COLOR", "SSH_CONNECTION", "TMUX"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.usefixtures("fixed_environment")
@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
@pytest.mark.parametrize("name", ENVIRONMENT_KEYS)
def test_screen_of_the_environment(tiny_store: Path, name: str, size: tuple[int, int]) -> None:
    screenshot = snapshot(tiny_store, size, ["w", *ENVIRONMENT_KEYS[name]], RenderOptions())
    check(f"{name}-{size[0]}x{size[1]}", screenshot.text)


@pytest.mark.usefixtures("fixed_environment")
@pytest.mark.parametrize("name", ENVIRONMENT_KEYS)
def test_ascii_screen_of_the_environment(tiny_store: Path, name: str) -> None:
    screenshot = snapshot(
        tiny_store, (80, 24), ["w", *ENVIRONMENT_KEYS[name]], RenderOptions(ascii=True)
    )
    assert screenshot.text.isascii()
    check(f"{name}-ascii", screenshot.text)


def check(name: str, text: str) -> None:
    path = SCREENS / f"{name}.txt"
    if os.environ.get("S2R_UPDATE_SCREENS"):
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    assert text == path.read_text(encoding="utf-8"), f"{path.name} has changed"
