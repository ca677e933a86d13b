"""Every view at every size compared with stored text screens.

`S2R_UPDATE_SCREENS=1 pytest tests/app/test_screen_snapshots.py` rewrites them; check the diff.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest

from s2rstore.reader import Store
from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle, snapshot, take_screenshot
from s2rtui.canvas import RenderOptions
from s2rtui.charts.registry import VIEWS
from s2rtui.charts.shared.instance_input import instance_input
from s2rtui.loaders.live_prediction import LivePredictor
from s2rtui.session.session import Session
from s2rtui.terminal import diagnostics
from s2rtui.terminal.diagnostics import PARTS
from s2rtui.testing import assert_screen
from s2rtui.user_data.notebook import ReadNotebook
from tests.support import tiny
from tests.support.application import press
from tests.support.copies import copy_store
from tests.support.drives import add_drives

SCREENS = Path(__file__).parent / "screens"
KEYS = {view.name: (view.key,) for view in VIEWS if view.name != "adjust"}
KEYS |= {
    "map-full": ("m", "m"), "map-glyph": ("m",), "map-heat": ("o", "o", "C"),
    "map-brush": ("x", "Z"), "umap-brush": ("4", "x"), "orientation-brush": ("5", "x"),
    "rooms-brush": ("6", "x", "shift+down"), "errors-brush": ("7", "x"),
    "scatter-brush": ("X", "x"), "help": ("question_mark",), "tour": ("T",), "jump": ("space",),
    "selections": ("b", "f"), "query": ("slash",), "adjust": ("a", "right", "right", "down"),
    "doctor": ("D",),
}  # fmt: skip
"""Keys that open a view or screen from the selection `worst15`."""


@pytest.mark.parametrize("keys", ["c", "c,M", "c,M,9"])
def test_screen_of_a_run_with_trained_instances(tmp_path, keys):
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
            sides[name] = SimpleNamespace(
                rgb=side.rgb, depth=side.depth, x=pose.x, y=pose.y, heading=pose.heading,
                error=pose.error, heading_error=pose.heading_error, original=None,
            )  # fmt: skip
        yield SimpleNamespace(iid=iid, side=sides.__getitem__)


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
@pytest.mark.parametrize("shown", ["80x24", "120x40", "200x60", "ascii"])
async def test_screens(tiny_store, tmp_path, shown, monkeypatch):
    """One application opens every view from the same state."""
    monkeypatch.chdir(tmp_path)  # views show the path of the store
    add_drives(store := copy_store(tiny_store, Path(tiny_store.name)))
    columns, rows = (80, 24) if shown == "ascii" else map(int, shown.split("x"))
    session = Session(store, notebooks=ReadNotebook)
    app = S2RApp(session, RenderOptions(ascii=shown == "ascii"))
    app.load_scheduler.debounce_seconds = 0.001
    async with app.run_test(size=(columns, rows)) as pilot:
        await press(app, pilot, "w")
        state, resources = session.state, app.loaded
        for name, keys in KEYS.items():
            await press(app, pilot, *keys)
            text = take_screenshot(app).text
            assert text.isascii() or shown != "ascii"
            check(f"{name}-{shown}", text)
            if app.screen is not app.default_screen or app.prompt.is_open:
                await press(app, pilot, "escape")
            session.set_state(state)
            app.loaded = resources
            app.updater.refresh()
            await settle(app, pilot)


def check(name: str, text: str) -> None:
    assert_screen(SCREENS / f"{name}.txt", text)
