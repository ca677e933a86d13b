"""The help screen: `/` leaves the entries that match, enter goes to the first one."""

from __future__ import annotations

from pathlib import Path

import pytest
from textual.containers import VerticalScroll
from textual.widgets import Static

from s2rtui.app.app import S2RApp
from s2rtui.app.key_bindings import ACTIONS, BY_NAME
from s2rtui.app.pilot import settle
from s2rtui.app.screens.help_content import QUESTIONS, help_lines, help_text
from s2rtui.canvas import RenderOptions
from s2rtui.session import Session


def test_every_match_holds_all_words() -> None:
    lines = [line for line in help_lines(searched="next Run") if line.startswith("  ")]
    assert len(lines) >= 2
    assert all("next" in line.lower() and "run" in line.lower() for line in lines)
    assert all(line in help_text().splitlines() for line in lines)


def test_one_character_finds_a_key_in_its_case() -> None:
    small, large = (help_lines(searched=key) for key in "wW")
    assert any(BY_NAME["worst_real"].description in line for line in small)
    assert not any(BY_NAME["worst_sim"].description in line for line in small)
    assert any(BY_NAME["worst_sim"].description in line for line in large)


def test_a_text_that_is_nowhere_leaves_no_line() -> None:
    assert help_lines(searched="zeppelin") == []


@pytest.mark.parametrize("question", QUESTIONS, ids=lambda question: question.text)
def test_a_question_is_answered_by_at_most_six_keys(question) -> None:
    pressed = " ".join(key for key, _ in question.entries).split()
    assert 1 <= len(pressed) <= 6
    assert set(pressed) <= {action.key for action in ACTIONS}
    assert all(len(text) <= 54 for _, text in question.entries)  # one line at 80 columns


async def test_typing_filters_and_enter_goes_to_the_first_match(tiny_store: Path) -> None:
    app = S2RApp(Session(tiny_store), RenderOptions())
    async with app.run_test(size=(80, 24)) as pilot:
        await settle(app, pilot)
        await pilot.press("question_mark", "slash", *"lasso")
        await settle(app, pilot)
        text = app.screen.query_one("#help-text", Static)
        shown = [line for line in str(text.render()).splitlines() if line.startswith("  ")]
        assert shown
        assert all("lasso" in line for line in shown)
        await pilot.press("enter")
        await settle(app, pilot)
        assert str(text.render()) == help_text()
        row = help_text().splitlines().index(shown[0])
        area = app.screen.query_one("#help", VerticalScroll)
        assert area.scroll_offset.y <= row < area.scroll_offset.y + area.size.height
        await pilot.press("slash", "q", "escape")
        await settle(app, pilot)
        assert app.screen is not app.default_screen  # escape left the search alone
        await pilot.press("escape")
        await settle(app, pilot)
        assert app.screen is app.default_screen
    assert app.fault is None
