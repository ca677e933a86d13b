"""An unexpected error in an action or a handler is shown, and the application runs on."""

from __future__ import annotations

from pathlib import Path

import pytest

from s2rtui.app.app import S2RApp
from s2rtui.app.controllers.navigation import NavigationController
from s2rtui.app.pilot import settle
from s2rtui.canvas import RenderOptions
from s2rtui.charts.map.view import VIEW as MAP
from s2rtui.session import Session


def fail(*arguments: object) -> None:
    raise KeyError("no such thing")


@pytest.mark.parametrize("keys", [("V",), ("x", "right", "enter"), "drag"])
async def test_an_unexpected_error_is_shown_and_the_application_runs_on(
    tiny_store: Path, monkeypatch: pytest.MonkeyPatch, keys: tuple[str, ...] | str
) -> None:
    monkeypatch.setattr(NavigationController, "fill_screen", fail)
    monkeypatch.setattr(type(MAP), "to_expression", fail)
    app = S2RApp(Session(tiny_store), RenderOptions())
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        if keys == "drag":
            await pilot.mouse_down("#map", offset=(20, 10))
            await pilot.mouse_up("#map", offset=(40, 20))
        else:
            await pilot.press(*keys)
        monkeypatch.undo()
        await settle(app, pilot)
        assert app.fault is None
        assert app.session.state.message == "internal error: KeyError: 'no such thing'"
        assert app.session.state.is_error
        await pilot.press("escape", "escape", "w")
        await settle(app, pilot)
        assert app.session.state.expression == "worst15"


async def test_a_state_that_cannot_be_drawn_is_left(
    tiny_store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    app = S2RApp(Session(tiny_store), RenderOptions())
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        before = app.session.state
        draw = type(MAP).draw

        def draw_one_mode(self: object, scene, *arguments: object):
            return draw(self, scene, *arguments) if scene.state.map_mode == "colour" else fail()

        monkeypatch.setattr(type(MAP), "draw", draw_one_mode)
        await pilot.press("m")
        await settle(app, pilot)
        assert app.fault is None
        assert app.session.state.map_mode == before.map_mode
        assert "internal error" in app.session.state.message
