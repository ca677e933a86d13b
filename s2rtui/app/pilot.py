"""Drive the application without a terminal: press keys, wait for data, take the screen."""

from __future__ import annotations

import asyncio
import time
import unicodedata
from collections.abc import Sequence
from pathlib import Path

from textual.keys import KEY_NAME_REPLACEMENTS, Keys
from textual.pilot import Pilot

from s2rstore.errors import DamagedStoreError, RequestError
from s2rtui.app.app import S2RApp
from s2rtui.canvas import RenderOptions
from s2rtui.export.screenshot import Screenshot
from s2rtui.session.session import Session
from s2rtui.session.state import State
from s2rtui.user_data.notebook import ReadNotebook

_TIMEOUT = 300.0
"""Seconds; loading a model can take many."""


def is_key(name: str) -> bool:
    """Whether a name is a key: a character, or Textual's name of one."""
    last = name if len(name) == 1 else name.split("+")[-1]
    words = {*(key.value for key in Keys), *KEY_NAME_REPLACEMENTS.values()}
    if len(last) == 1 or last in words:
        return True
    try:
        return bool(unicodedata.lookup(last.replace("_", " ")))
    except KeyError:
        return False


def take_screenshot(app: S2RApp) -> Screenshot:
    """The present screen of the application."""
    return Screenshot.of(app.screen)


async def settle(app: S2RApp, pilot: Pilot[None]) -> None:
    """Wait until everything the state needs is loaded and drawn.

    Raises RequestError if that takes minutes.
    """
    limit = time.monotonic() + _TIMEOUT
    await pilot.pause()
    while not app.settled and app.is_running:
        if time.monotonic() > limit:
            raise RequestError(f"the screen is not complete after {_TIMEOUT:.0f} s")
        await asyncio.sleep(0.005)
        await pilot.pause()
    await pilot.pause()


def snapshot(
    path: Path,
    size: tuple[int, int],
    keys: Sequence[str] = (),
    options: RenderOptions | None = None,
    state: State | None = None,
    run: str | None = None,
    with_trained: bool = False,
    poses: Path | None = None,
) -> Screenshot:
    """The screen of `size` columns and rows after pressing `keys`, with all data loaded.

    It begins with a state of another session on the store, or on `run`. `with_trained` includes the
    instances that the models were trained on; `poses` is a CSV file of planned poses for the map.
    Raises DamagedStoreError where a file of the store that the screen needs cannot be read.
    """
    history = None if state is None or state.history is None else state.history.path
    session = Session(path, run, ReadNotebook, history, with_trained, poses=poses)
    if state is not None:
        session.set_state(state)
    app = S2RApp(session, options or RenderOptions())
    app.load_scheduler.debounce_seconds = 0.001

    async def drive() -> Screenshot:
        async with app.run_test(size=size) as pilot:
            await settle(app, pilot)
            for key in keys:
                await pilot.press(key)
                await settle(app, pilot)
            if app.load_scheduler.damage:
                raise DamagedStoreError(app.load_scheduler.damage)
            return take_screenshot(app)

    return asyncio.run(drive())
