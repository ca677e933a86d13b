"""The row of the rooms view that holds the cursor's instance is selected with Enter."""

from __future__ import annotations

from pathlib import Path

import pytest

from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle
from s2rtui.canvas import RenderOptions
from s2rtui.charts.registry import BY_NAME
from s2rtui.session import Session


@pytest.mark.parametrize("groupings", range(4))
async def test_enter_selects_the_row_of_the_instance(tiny_store: Path, groupings: int) -> None:
    session = Session(tiny_store)
    session.select("all")
    app = S2RApp(session, RenderOptions())
    app.load_scheduler.debounce_seconds = 0.001
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press(BY_NAME["rooms"].key, *["O"] * groupings)
        await settle(app, pilot)
        cursor = session.state.cursor
        await pilot.press("enter")
        await settle(app, pilot)
        state = session.state
        assert state.expression != "all"
        assert state.message == f"selected {state.expression}: {state.count}"
        assert state.cursor is not None
        assert state.selected[cursor]
