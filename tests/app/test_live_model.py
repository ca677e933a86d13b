"""The model of the panel that adjusts: at work while the panel is open, let go a while after."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle
from s2rtui.canvas import RenderOptions
from s2rtui.loaders import live_prediction
from s2rtui.session import Session, view_settings


class Bench:
    """Notes what it is asked for."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def read(self, *_: object) -> dict[str, object]:
        self.told.append("read")
        return {}

    def release(self) -> None:
        self.told.append("leave")


async def test_without_its_panel_the_model_rests_and_goes(
    tiny_store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench()
    monkeypatch.setattr(live_prediction, "_PREDICTOR", bench)
    app = S2RApp(Session(tiny_store), RenderOptions())
    app.load_scheduler.debounce_seconds, app.load_scheduler.release_seconds = 0.001, 0.05
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        await pilot.press("a")
        await settle(app, pilot)
        assert bench.told == ["read"]
        await asyncio.sleep(0.2)
        assert bench.told == ["read"]
        app.session.dispatch(view_settings.show_view, "instance", "tab")
        app.renderer.refresh()
        await pilot.press("n")
        await settle(app, pilot)
        async with asyncio.timeout(10):
            while bench.told == ["read"]:
                await pilot.pause()
        assert bench.told == ["read", "leave"]
        await pilot.press("a")
        await settle(app, pilot)
        assert bench.told == ["read", "leave", "read"]
