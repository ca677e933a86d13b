"""A message, an error too, goes with the next change; what changes nothing leaves it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import pytest

from s2rtui.app.actions import ACTIONS
from s2rtui.session import Session, State, view_settings
from s2rtui.session.state import Adjust, Slider

BEFORE = "told by an earlier key"
MESSAGE = ("message", "is_error", "keeps_message")
SLIDER = Slider("real", "brightness", 0.5, 1.5, 1.0, 0.05, "")
KEYS: dict[str, Callable[[Session], object]] = {
    **{action.name: action.do for action in ACTIONS if action.do is not None},
    "another view": lambda s: s.dispatch(view_settings.show_view, "list", "tab"),
    "a view on the screen": lambda s: s.dispatch(view_settings.activate, "umap"),
}


def differs(one: State, other: State) -> bool:
    """In anything but what is told."""
    names = (each.name for each in fields(State) if each.name not in MESSAGE)
    return any(getattr(one, name) is not getattr(other, name) for name in names)


@pytest.fixture(scope="module")
def session(tiny_store: Path) -> Session:
    return Session(tiny_store)


@pytest.mark.parametrize("is_error", [False, True])
def test_a_message_goes_with_the_next_change(session: Session, is_error: bool) -> None:
    adjust = Adjust("vanilla", ((SLIDER.key, 1.0),), 0, (SLIDER,))
    first = replace(session.state, adjust=adjust, past=("all",), future=("best15",), viewport=None)
    stays, changing = [], 0
    for name, key in KEYS.items():
        session.set_state(replace(first, message=BEFORE, is_error=is_error))
        before = session.state
        key(session)
        after = session.state
        changing += differs(before, after)
        if differs(before, after) and (after.message == BEFORE or after.is_error):
            stays.append(name)
    assert stays == []
    assert changing > len(KEYS) / 2


def test_what_changes_nothing_leaves_an_error(session: Session) -> None:
    session.show_message("an error", is_error=True)
    session.dispatch(view_settings.activate, session.state.view)
    assert (session.state.message, session.state.is_error) == ("an error", True)


def test_the_order_of_a_list_is_told_until_something_else_changes(session: Session) -> None:
    KEYS["sort"](session)
    assert session.state.message.startswith("sorted by ")
    KEYS["another view"](session)
    assert session.state.message == ""
