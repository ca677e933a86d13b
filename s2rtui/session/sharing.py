"""A selection as one line of text that another user can paste."""

from __future__ import annotations

import re
from dataclasses import dataclass

from s2rstore.errors import RequestError
from s2rtui.notebook import SavedSelection
from s2rtui.session.session import Session
from s2rtui.session.state import State

_FACTS = re.compile(
    r"\s+# data set (?P<hash>[0-9a-f]+), generation (?P<generation>\d+), "
    r"run (?P<run>.+?), (?P<count>\d+) instances\s*\Z"
)
_HASH_LENGTH = 12


@dataclass(frozen=True, slots=True)
class Shared:
    """An expression and, where it was shared with them, the facts that it was true of."""

    expression: str
    dataset: str = ""
    generation: int = 0
    run: str = ""
    count: int = 0


def shared_text(session: Session) -> str:
    """The expression, and after a `#` what it was evaluated on."""
    state = session.state
    count = int(state.selected.sum())
    saved = SavedSelection(state.expression, state.generation, state.run, count)
    return written(saved, session.store.dataset.hash)


def written(saved: SavedSelection, dataset_hash: str) -> str:
    """A saved selection as a line that `read` understands."""
    return (
        f"{saved.expression}  # data set {dataset_hash[:_HASH_LENGTH]}, "
        f"generation {saved.generation}, run {saved.run}, {saved.count} instances"
    )


def read(text: str) -> Shared:
    """What was shared; text without facts is an expression alone."""
    found = _FACTS.search(text)
    if found is None:
        return Shared(text)
    return Shared(
        text[: found.start()], found["hash"], int(found["generation"]), found["run"],
        int(found["count"]),
    )  # fmt: skip


def take(session: Session, text: str) -> State:
    """Select what was typed or pasted; tells where it means something else here.

    Raises RequestError for a selection of another data set.
    """
    shared = read(text)
    if shared.dataset and not session.store.dataset.hash.startswith(shared.dataset):
        raise RequestError(
            f"this was selected on data set {shared.dataset}; "
            f"here is {session.store.dataset.hash[:_HASH_LENGTH]}"
        )
    before = session.state
    try:
        if shared.run in before.runs and shared.run != before.run:
            session.put_run(shared.run)
        state = session.select(shared.expression)
    except RequestError:
        session.set(before)
        raise
    return compared(session, state, shared) if shared.dataset else state


def compared(session: Session, state: State, shared: Shared) -> State:
    """The state with a word about how it differs from what was saved."""
    count = int(state.selected.sum())
    if count == shared.count and shared.run == state.run:
        return state
    told = f"evaluated anew: {count} instances, {shared.count} at generation {shared.generation}"
    if shared.run != state.run:
        told += f" on run {shared.run}"
    return session.tell(told)
