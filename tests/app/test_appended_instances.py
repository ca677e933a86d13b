"""The open application goes on when instances are appended to its store."""

from __future__ import annotations

import asyncio
from pathlib import Path

from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle
from s2rtui.canvas import RenderOptions
from s2rtui.charts.registry import VIEWS
from s2rtui.session import Session
from tests.support.appended import append_trajectory

N, ADDED = 40, 5


def test_every_view_draws_after_an_append(store_copy: Path) -> None:
    async def run() -> None:
        app = S2RApp(Session(store_copy), RenderOptions())
        async with app.run_test(size=(120, 40)) as pilot:
            await settle(app, pilot)
            append_trajectory(store_copy, "a0", ADDED)
            app.store_updates.check_store()
            await settle(app, pilot)
            assert app.session.state.newest > app.session.state.generation
            await pilot.press("g")
            await settle(app, pilot)
            assert "5 instances added" in app.session.state.message
            for view in VIEWS:
                if view.name == "adjust":  # the store has no weights
                    continue
                await pilot.press(view.key)
                await settle(app, pilot)
                assert not app.session.state.is_error, (view.name, app.session.state.message)
            assert app.session.state.selected.size == N + ADDED
            assert "computed for 40 of 45 instances" in app.renderer.status_text()
            app.session.set_cursor(N)
            app.renderer.refresh()
            await settle(app, pilot)
            assert not app.session.state.is_error
            notes = dict(app.resources.pictures.notes)
            assert notes["heat"] == (
                "instance 40: feature_distance of run 'vanilla' is not computed; "
                "run `s2r precompute`"
            )
            assert app.resources.pictures.sim.rgb.size

    asyncio.run(run())
