"""The live model is released some time after its panel is hidden."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle
from s2rtui.canvas import RenderOptions
from s2rtui.loaders import live_prediction
from s2rtui.session import Session, view_settings
from s2rtui.session.state import Adjust


class RecordingPredictor:
    """Records its calls."""

    def __init__(self) -> None:
        self.calls: list[str] = []

    def read(self, *_: object) -> dict[str, object]:
        self.calls.append("read")
        return {}

    def release(self) -> None:
        self.calls.append("leave")


async def test_a_hidden_panel_releases_the_model(
    tiny_store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    predictor = RecordingPredictor()
    monkeypatch.setattr(live_prediction, "_PREDICTOR", predictor)
    app = S2RApp(Session(tiny_store), RenderOptions())
    app.load_scheduler.debounce_seconds, app.load_scheduler.release_seconds = 0.001, 0.05
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        await pilot.press("a")
        await settle(app, pilot)
        assert predictor.calls == ["read"]
        await asyncio.sleep(0.2)
        assert predictor.calls == ["read"]
        app.session.dispatch(view_settings.show_view, "instance", "tab")
        app.renderer.refresh()
        await pilot.press("n")
        await settle(app, pilot)
        async with asyncio.timeout(10):
            while predictor.calls == ["read"]:
                await pilot.pause()
        assert predictor.calls == ["read", "leave"]
        await pilot.press("a")
        await settle(app, pilot)
        assert predictor.calls == ["read", "leave", "read"]


def test_another_order_of_the_steps_is_predicted_again(tiny_store: Path) -> None:
    session = Session(tiny_store)
    steps = (("real", "brightness"), ("real", "contrast"))
    keys = {
        live_prediction.live_key(
            session.store,
            replace(session.state, tab="adjust", adjust=Adjust(session.state.run, run_steps=order)),
        )
        for order in (steps, steps[::-1])
    }
    assert len(keys) == 2
