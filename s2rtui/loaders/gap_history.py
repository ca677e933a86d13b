"""Load the history of nightly gaps whenever its file changes."""

from __future__ import annotations

from s2rstore.gap_history import reader
from s2rstore.reader import Store
from s2rtui.loaders.loader import Fields, Key, LoadContext
from s2rtui.session.state import State


def history_key(store: Store, state: State) -> Key | None:
    return None if state.history is None else (state.history,)


def read_history(store: Store, state: State, context: LoadContext) -> Fields:
    """Raises RequestError for a file that is no history."""
    assert state.history is not None
    return {"history": reader.read(state.history.path)}
