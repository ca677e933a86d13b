"""What is to come after a while comes, also where the process stands still meanwhile."""

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


async def test_pictures_come_although_the_process_stands_still(
    tiny_store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    app, leaps, clock = S2RApp(Session(tiny_store), RenderOptions()), count(), _time.get_time
    app.load_scheduler.debounce_seconds = 0.001
    async with app.run_test(size=(120, 40)) as pilot:
        monkeypatch.setattr(_time, "get_time", lambda: clock() + 0.01 * next(leaps))
        await asyncio.wait_for(settle(app, pilot), 20)
        assert app.resources.pictures is not None


async def test_a_call_that_is_cancelled_never_comes(tiny_store: Path) -> None:
    app, called = S2RApp(Session(tiny_store), RenderOptions()), []
    async with app.run_test(size=(80, 24)) as pilot:
        call_after(app, 0, lambda: called.append("dropped")).cancel()
        call_after(app, 0, lambda: called.append("kept"))
        await asyncio.sleep(0.01)
        await pilot.pause()
    assert called == ["kept"]
