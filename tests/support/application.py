"""The application in Textual's test pilot."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from textual.pilot import Pilot

from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle
from s2rtui.canvas import RenderOptions
from s2rtui.security import Permissions
from s2rtui.session.session import Session
from s2rtui.user_data.notebook import Notebook


def make_app(
    store: Path,
    options: RenderOptions | None = None,
    folder: Path | None = None,
    restricted: bool = False,
    with_trained: bool = False,
    run: str | None = None,
) -> S2RApp:
    """The application of a store, which loads data at once; exports are written to `folder`."""
    session = Session(store, run, Notebook, with_trained=with_trained)
    access = Permissions.for_store(store, restricted)
    app = S2RApp(session, options or RenderOptions(), access)
    app.output_folder = folder or app.output_folder
    app.load_scheduler.debounce_seconds = 0.001
    return app


@asynccontextmanager
async def running(
    store: Path, *arguments: Any, size: tuple[int, int] = (120, 40), **options: Any
) -> AsyncIterator[tuple[S2RApp, Pilot[None]]]:
    """Run the application of `make_app`; its data is loaded and drawn."""
    app = make_app(store, *arguments, **options)
    async with app.run_test(size=size) as pilot:
        await settle(app, pilot)
        yield app, pilot


async def press(app: S2RApp, pilot: Pilot[None], *keys: str) -> None:
    """Press keys, and wait after each of them until its data is loaded and drawn."""
    for key in keys:
        await pilot.press(key)
        await settle(app, pilot)
