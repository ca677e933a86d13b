"""Delayed calls run although the event loop was blocked, and cancelled calls never run."""

from __future__ import annotations

import asyncio
from itertools import count
from pathlib import Path

import pytest
from textual import _time

from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle
from s2rtui.canvas import RenderOptions
from s2rtui.session import Session
from s2rtui.terminal.textual_compat import call_after


async def test_images_load_although_the_clock_jumps(
    tiny_store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    app, ticks, clock = S2RApp(Session(tiny_store), RenderOptions()), count(), _time.get_time
    app.load_scheduler.debounce_seconds = 0.001
    async with app.run_test(size=(120, 40)) as pilot:
        monkeypatch.setattr(_time, "get_time", lambda: clock() + 0.01 * next(ticks))
        await asyncio.wait_for(settle(app, pilot), 20)
        assert app.resources.pictures is not None


async def test_a_cancelled_call_never_runs(tiny_store: Path) -> None:
    app, calls = S2RApp(Session(tiny_store), RenderOptions()), []
    async with app.run_test(size=(80, 24)) as pilot:
        call_after(app, 0, lambda: calls.append("dropped")).cancel()
        call_after(app, 0, lambda: calls.append("kept"))
        await asyncio.sleep(0.01)
        await pilot.pause()
    assert calls == ["kept"]
