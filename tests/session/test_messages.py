"""Messages are cleared by the next change of the state and kept when nothing changes."""

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import pytest

from s2rstore.language import parse
from s2rstore.language.syntax_tree import Everything
from s2rtui.app.key_bindings import ACTIONS
from s2rtui.session import navigation, view_settings
from s2rtui.session.session import Session
from s2rtui.session.state import Adjust, Slider, State, Step

BEFORE = "message of an earlier key"
MESSAGE_FIELDS = ("message", "is_error", "keeps_message")
SLIDER = Slider("real", "brightness", 0.5, 1.5, 1.0, 0.05, "")
KEYS: dict[str, Callable[[Session], object]] = {
    **{action.name: action.do for action in ACTIONS if action.do is not None},
    "another view": lambda s: s.dispatch(view_settings.show_view, "list", "tab"),
    "a view on the screen": lambda s: s.dispatch(view_settings.activate, "umap"),
}


def differs(first: State, other: State) -> bool:
    """Whether two states differ in any field other than the message."""
    names = (field.name for field in fields(State) if field.name not in MESSAGE_FIELDS)
    return any(getattr(first, name) is not getattr(other, name) for name in names)


@pytest.fixture(scope="module")
def session(tiny_store: Path) -> Session:
    return Session(tiny_store)


@pytest.mark.parametrize("is_error", [False, True])
def test_a_message_is_cleared_by_the_next_change(session, is_error):
    adjust = Adjust("vanilla", ((SLIDER.key, 1.0),), 0, (SLIDER,))
    start = replace(
        session.state,
        adjust=adjust,
        past=(Step(Everything()),),
        future=(Step(parse("best15")),),
        viewports=(),
    )
    kept_messages, change_count = [], 0
    for name, key in KEYS.items():
        session.set_state(replace(start, message=BEFORE, is_error=is_error))
        before = session.state
        key(session)
        after = session.state
        change_count += differs(before, after)
        if differs(before, after) and (after.message == BEFORE or after.is_error):
            kept_messages.append(name)
    assert kept_messages == []
    assert change_count > len(KEYS) / 2


def test_an_error_is_kept_when_nothing_changes(session):
    session.show_message("an error", is_error=True)
    session.dispatch(view_settings.activate, session.state.view)
    assert (session.state.message, session.state.is_error) == ("an error", True)


def test_m_says_that_a_run_has_no_trained_instances(session):
    state = session.dispatch(navigation.toggle_trained)
    assert state.message.startswith("nothing to include: ")
    assert "vanilla" in state.message
    assert "\n" not in state.message
    assert "trained" not in state.count_text
