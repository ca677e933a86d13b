"""The application without a terminal: press keys, wait until it rests, take the screen."""

from __future__ import annotations

import asyncio
import time
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.segment import Segment
from textual.app import App
from textual.keys import KEY_NAME_REPLACEMENTS, Keys
from textual.pilot import Pilot

from s2rstore.errors import RequestError
from s2rtui.app.app import S2RApp
from s2rtui.app.controllers.base import Desk
from s2rtui.canvas import DARK, RenderOptions
from s2rtui.session import Session, State
from s2rtui.user_data.notebook import ReadNotebook

_PATIENCE = 300.0
"""Seconds; loading a model takes some."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The screen's lines as styled segments."""

    lines: tuple[tuple[Segment, ...], ...]

    @property
    def text(self) -> str:
        rows = ("".join(segment.text for segment in line).rstrip() for line in self.lines)
        return "\n".join(rows) + "\n"

    def png(self, look: RenderOptions, size: tuple[int, int] | None = None) -> bytes:
        """As PNG, in the upper left of `size` pixels where given."""
        from s2rtui.export.rasterizer import rasterize_png

        return rasterize_png(self.lines, theme=look.theme, size=size)


def is_key(name: str) -> bool:
    """Whether a name is a key that can be pressed: a character, or Textual's word for it."""
    last = name if len(name) == 1 else name.split("+")[-1]
    words = {*(key.value for key in Keys), *KEY_NAME_REPLACEMENTS.values()}
    if len(last) == 1 or last in words:
        return True
    try:
        return bool(unicodedata.lookup(last.replace("_", " ")))
    except KeyError:
        return False


def take(app: App[Any]) -> Snapshot:
    """What the compositor would draw now."""
    strips = app.screen._compositor.render_strips()
    return Snapshot(tuple(tuple(strip) for strip in strips))


def screen_png(app: Desk) -> bytes:
    """The application's screen as PNG."""
    return take(app).png(app.look)


async def settle(app: S2RApp, pilot: Pilot[None]) -> None:
    """Wait until no worker runs and the pictures are those of the state.

    Raises RequestError where that takes minutes.
    """
    limit = time.monotonic() + _PATIENCE
    await pilot.pause()
    while not app.settled and app.is_running:
        if time.monotonic() > limit:
            raise RequestError(f"the screen is not complete after {_PATIENCE:.0f} s")
        await asyncio.sleep(0.005)
        await pilot.pause()
    await pilot.pause()


def snapshot(
    path: Path,
    size: tuple[int, int],
    keys: Sequence[str] = (),
    look: RenderOptions | None = None,
    run: str | None = None,
) -> Snapshot:
    """The screen of `size` columns and rows after pressing `keys`, once everything is read."""
    return asyncio.run(_snapshot(path, size, keys, look or RenderOptions(theme=DARK), run))


def screen_of(path: Path, state: State, size: tuple[int, int], look: RenderOptions) -> bytes:
    """The screen of one state as PNG of `size` pixels: cells of 10 x 20, the rest is ground."""
    cells = (size[0] // 10, size[1] // 20)
    shot = asyncio.run(_snapshot(path, cells, (), look, state.run, state))
    return shot.png(look, size)


async def _snapshot(
    path: Path,
    size: tuple[int, int],
    keys: Sequence[str],
    look: RenderOptions,
    run: str | None,
    state: State | None = None,
) -> Snapshot:
    history = state.history if state is not None else None
    session = Session(path, run, ReadNotebook, None if history is None else history.path)
    if state is not None:
        session.set(state)
    app = S2RApp(session, look)
    app.feeding.rest_seconds = 0.001
    async with app.run_test(size=size) as pilot:
        await settle(app, pilot)
        for key in keys:
            await pilot.press(key)
            await settle(app, pilot)
        return take(app)
