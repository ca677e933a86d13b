"""Modal screens: several keys at once, letters of the jump mode, search in the help."""

import pytest
from textual import events
from textual.containers import VerticalScroll
from textual.widgets import OptionList, Static

from s2rtui.app.app import S2RApp
from s2rtui.app.key_bindings import ACTIONS, BY_NAME
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.app.screens.help_content import QUESTIONS, help_lines
from s2rtui.app.screens.jump import JumpScreen
from s2rtui.app.status_line import TextBar
from s2rtui.canvas import RenderOptions
from s2rtui.session.session import Session
from s2rtui.user_data.notebook import Notebook, SavedSelection
from tests.support.application import press, running
from tests.support.copies import copy_store

CLOSING_KEYS = {
    "space": ("", ("a", "n")),
    "f": ("history", ("enter", "enter")),
    "D": ("what you should see", ("escape", "escape")),
    "question_mark": ("", ("enter", "enter")),
    "T": ("reality is red", ("n", "n")),
}
"""Per key that opens a screen, a text on it, and keys that close it and are harmless below."""


async def test_several_closing_keys_close_a_screen_once(tiny_store):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        for opening, (shown, closing_keys) in CLOSING_KEYS.items():
            await press(app, pilot, opening)
            assert app.screen is not app.default_screen, opening
            assert shown in take_screenshot(app).text
            if opening == "D":
                await pilot.click(offset=(60, 20))
            for key in closing_keys:
                app.post_message(events.Key(key, key if len(key) == 1 else None))
            await settle(app, pilot)
            assert app.screen_stack == [app.default_screen], opening
        await press(app, pilot, "w")
        assert app.session.state.expression == "worst15"
    assert app.fault is None


def save_selections(*names: str) -> Notebook:
    notebook = Notebook("0" * 64)
    for name in names:
        notebook.save(name, SavedSelection("worst15", 1, "dataaug", 6))
    return notebook


async def test_deleting_selections_keeps_the_row_and_names_what_uses_them(tiny_store):
    notebook = save_selections("a", "c", "d", "e", "f")
    notebook.save("b", SavedSelection("@a", 1, "dataaug", 6))
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "f", "d")
        title = app.screen.query_one("#selections-title", Static)
        assert "@a is used by @b" in str(title.render())
        await press(app, pilot, "down", "down", "d")
        assert str(title.render()) == "saved selections and history"
        assert app.screen.query_one(OptionList).highlighted == 2
        await press(app, pilot, "d")
        notebook.refresh()
        assert list(notebook.notes.selections) == ["a", "c", "f", "b"]
        await press(app, pilot, "escape")
        app.session.select("@b & all")
        await press(app, pilot, "f", "down", "down", "down", "d", "escape")
        assert app.session.state.is_error
        assert "the selection is unchanged" in app.session.state.message


@pytest.mark.parametrize(
    ("expression", "name"), [("traj:a", "traj all run 所.s2r"), ('run("dataaug").gap > 0', "s.s2r")]
)
async def test_jump_letters_lie_on_their_parts_of_the_status_line(
    tiny_store, tmp_path, expression, name
):
    session = Session(copy_store(tiny_store, tmp_path / name))
    session.select(expression)
    app = S2RApp(session, RenderOptions())
    async with app.run_test(size=(200, 60)) as pilot:
        await settle(app, pilot)
        await pilot.press("space")
        assert isinstance(app.screen, JumpScreen)
        bar = app.screen_stack[0].query_one("#status", TextBar)
        line, padding = bar.render_line(0), bar.styles.padding.left
        targets = {
            target.action: line.crop(target.x - padding, 200).text
            for target in app.screen._targets.values()
            if target.y == 0 and target.action.startswith("do(")
        }
        shown = session.state.expression
        assert targets["do('trajectory')"].startswith("traj all │ ")
        assert targets["do('next_run')"].startswith("run vanilla")
        assert targets["do('edit')"].startswith(f"{shown} │ generation")


def test_the_search_finds_lines_with_all_words_and_keys_in_their_case():
    lines = [line for line in help_lines(searched="next Run") if line.startswith("  ")]
    assert len(lines) >= 2
    assert all("next" in line.lower() and "run" in line.lower() for line in lines)
    assert all(line in help_lines() for line in lines)
    small, large = (help_lines(searched=key) for key in "wW")
    assert any(BY_NAME["worst_real"].description in line for line in small)
    assert not any(BY_NAME["worst_sim"].description in line for line in small)
    assert any(BY_NAME["worst_sim"].description in line for line in large)
    assert help_lines(searched="zeppelin") == []


@pytest.mark.parametrize("question", QUESTIONS, ids=lambda question: question.text)
def test_a_question_is_answered_by_at_most_six_keys(question):
    pressed = " ".join(key for key, _ in question.entries).split()
    assert 1 <= len(pressed) <= 6
    assert set(pressed) <= {action.key for action in ACTIONS}
    assert all(len(text) <= 54 for _, text in question.entries)  # one line at 80 columns


async def test_typing_filters_and_enter_goes_to_the_first_match(tiny_store):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await pilot.press("question_mark", "slash", *"lasso")
        await settle(app, pilot)
        text = app.screen.query_one("#help-text", Static)
        shown = [line for line in str(text.render()).splitlines() if line.startswith("  ")]
        assert shown
        assert all("lasso" in line for line in shown)
        await press(app, pilot, "enter")
        assert str(text.render()) == "\n".join(help_lines())
        row = help_lines().index(shown[0])
        area = app.screen.query_one("#help", VerticalScroll)
        assert area.scroll_offset.y <= row < area.scroll_offset.y + area.size.height
        await pilot.press("slash", "q", "escape")
        await settle(app, pilot)
        assert app.screen is not app.default_screen  # escape left the search alone
        await press(app, pilot, "escape")
        assert app.screen is app.default_screen
    assert app.fault is None
