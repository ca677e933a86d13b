"""Modal screens receive several keys before the screen changes."""

from __future__ import annotations

from pathlib import Path

from textual import events
from textual.widgets import OptionList, Static

from s2rtui.app.pilot import settle
from s2rtui.user_data.notebook import Notebook, SavedSelection
from tests.support.application import make_app, press

CLOSING_KEYS = {
    "space": ("a", "n"),
    "f": ("enter", "enter"),
    "D": ("escape", "escape"),
    "question_mark": ("enter", "enter"),
    "T": ("n", "n"),
}
"""Per key that opens a screen, keys that close it and are harmless in the views below."""


async def test_several_closing_keys_close_a_screen_once(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(80, 24)) as pilot:
        for opening, closing_keys in CLOSING_KEYS.items():
            await press(app, pilot, opening)
            assert app.screen is not app.default_screen, opening
            for key in closing_keys:
                app.post_message(events.Key(key, key if len(key) == 1 else None))
            await settle(app, pilot)
            assert app.screen_stack == [app.default_screen], opening
    assert app.fault is None


def save_selections(*names: str) -> Notebook:
    notebook = Notebook("0" * 64)
    for name in names:
        notebook.save(name, SavedSelection("worst15", 1, "dataaug", 6))
    return notebook


async def test_deleting_a_selection_keeps_the_highlighted_row(tiny_store: Path) -> None:
    notebook = save_selections("a", "b", "c", "d")
    app = make_app(tiny_store)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("f", "down", "down", "d")
        await settle(app, pilot)
        assert app.screen.query_one(OptionList).highlighted == 2
        await pilot.press("d")
        await settle(app, pilot)
        notebook.refresh()
        assert list(notebook.notes.selections) == ["a", "b"]


async def test_an_error_is_cleared_by_the_next_deletion(tiny_store: Path) -> None:
    notebook = save_selections("a", "c")
    notebook.save("b", SavedSelection("@a", 1, "dataaug", 6))
    app = make_app(tiny_store)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("f", "d")
        await settle(app, pilot)
        title = app.screen.query_one("#selections-title", Static)
        assert "@a is used by @b" in str(title.render())
        await pilot.press("down", "d")
        await settle(app, pilot)
        assert str(title.render()) == "saved selections and history"


async def test_deleting_a_selection_in_use_shows_an_error(tiny_store: Path) -> None:
    save_selections("a")
    app = make_app(tiny_store)
    async with app.run_test(size=(80, 24)) as pilot:
        await settle(app, pilot)
        app.session.select("@a & all")
        await pilot.press("f", "d", "escape")
        await settle(app, pilot)
        assert app.session.state.is_error
        assert "the selection is unchanged" in app.session.state.message
