"""Screens above the views, when keys come faster than screens change."""

from __future__ import annotations

from pathlib import Path

import pytest
from textual import events

from s2rtui.app import S2RApp
from s2rtui.canvas import Look
from s2rtui.headless import settle
from s2rtui.notebook import Notebook
from s2rtui.session import Session

LEFT_BY = {
    "space": ("a", "n"),
    "f": ("enter", "enter"),
    "D": ("escape", "escape"),
    "question_mark": ("enter", "enter"),
    "T": ("n", "n"),
}
"""Keys that leave what a key opens, and that mean nothing bad to the views below."""


def app_on(store: Path) -> S2RApp:
    app = S2RApp(Session(store, notebooks=Notebook), Look())
    app.feeding.rest_seconds = 0.001
    return app


@pytest.mark.parametrize("opening", LEFT_BY)
async def test_a_screen_is_left_once_by_keys_of_one_packet(tiny_store: Path, opening: str) -> None:
    app = app_on(tiny_store)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        await pilot.press(opening)
        await settle(app, pilot)
        assert app.screen is not app.default_screen
        for key in LEFT_BY[opening]:
            app.post_message(events.Key(key, key if len(key) == 1 else None))
        await settle(app, pilot)
        assert app.screen_stack == [app.default_screen]
    assert app.fault is None
