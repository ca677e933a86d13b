"""Screens above the views, when keys come faster than screens change."""

from __future__ import annotations

from pathlib import Path

import pytest
from textual import events
from textual.widgets import OptionList, Static

from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle
from s2rtui.canvas import RenderOptions
from s2rtui.session import Session
from s2rtui.user_data.notebook import Notebook, SavedSelection

LEFT_BY = {
    "space": ("a", "n"),
    "f": ("enter", "enter"),
    "D": ("escape", "escape"),
    "question_mark": ("enter", "enter"),
    "T": ("n", "n"),
}
"""Keys that leave what a key opens, and that mean nothing bad to the views below."""


def make_app(store: Path) -> S2RApp:
    app = S2RApp(Session(store, notebooks=Notebook), RenderOptions())
    app.load_scheduler.debounce_seconds = 0.001
    return app


@pytest.mark.parametrize("opening", LEFT_BY)
async def test_a_screen_is_left_once_by_keys_of_one_packet(tiny_store: Path, opening: str) -> None:
    app = make_app(tiny_store)
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


def saved(*names: str) -> Notebook:
    book = Notebook("0" * 64)
    for name in names:
        book.save(name, SavedSelection("worst15", 1, "dataaug", 6))
    return book


async def test_forgetting_keeps_the_row(tiny_store: Path) -> None:
    book = saved("a", "b", "c", "d")
    app = make_app(tiny_store)
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.press("f", "down", "down", "d")
        await settle(app, pilot)
        assert app.screen.query_one(OptionList).highlighted == 2
        await pilot.press("d")
        await settle(app, pilot)
        book.refresh()
        assert list(book.notes.selections) == ["a", "b"]


async def test_an_old_refusal_goes_with_the_next_selection_that_is_forgotten(
    tiny_store: Path,
) -> None:
    book = saved("a", "c")
    book.save("b", SavedSelection("@a", 1, "dataaug", 6))
    app = make_app(tiny_store)
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.press("f", "d")
        await settle(app, pilot)
        title = app.screen.query_one("#selections-title", Static)
        assert "@a is used by @b" in str(title.render())
        await pilot.press("down", "d")
        await settle(app, pilot)
        assert str(title.render()) == "saved selections and history"


async def test_what_is_made_of_a_forgotten_selection_is_told(tiny_store: Path) -> None:
    saved("a")
    app = make_app(tiny_store)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        app.session.select("@a & all")
        await pilot.press("f", "d", "escape")
        await settle(app, pilot)
        assert app.session.state.is_error
        assert "the selection is unchanged" in app.session.state.message
