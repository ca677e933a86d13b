"""The application in Textual's test pilot."""

from __future__ import annotations

from pathlib import Path

from textual.pilot import Pilot

from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle
from s2rtui.canvas import RenderOptions
from s2rtui.security import Permissions
from s2rtui.session import Session
from s2rtui.user_data.notebook import Notebook


def make_app(
    store: Path,
    options: RenderOptions | None = None,
    folder: Path | None = None,
    restricted: bool = False,
    with_trained: bool = False,
) -> S2RApp:
    """The application of a store, which loads data at once; exports are written to `folder`."""
    session = Session(store, notebooks=Notebook, with_trained=with_trained)
    access = Permissions.for_store(store, restricted)
    app = S2RApp(session, options or RenderOptions(), folder, access)
    app.load_scheduler.debounce_seconds = 0.001
    return app


async def press(app: S2RApp, pilot: Pilot[None], *keys: str) -> None:
    """Press keys, and wait after each of them until its data is loaded and drawn."""
    for key in keys:
        await pilot.press(key)
        await settle(app, pilot)
