"""A selection as one line of text that another user can paste."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rtui.notebook import SavedSelection
from s2rtui.session import anew, loading, walking
from s2rtui.session.selecting import HISTORY
from s2rtui.session.session import Session
from s2rtui.session.state import State

_NAME = r'"(?:\\.|[^"\\])*"'
_FACTS = re.compile(
    r"\s+# data set (?P<hash>[0-9a-f]+), generation (?P<generation>\d+), "
    r"run (?P<run>.+?), (?P<count>\d+) instances"
    rf"(?: in (?P<trajectories>{_NAME}(?:, {_NAME})*))?\s*\Z"
)
_HASH_LENGTH = 12


@dataclass(frozen=True, slots=True)
class Shared:
    """An expression and, where it was shared with them, the data set and facts of its making."""

    expression: str
    dataset: str = ""
    saved: SavedSelection | None = None


def present(session: Session) -> SavedSelection:
    """The selection with what it was evaluated on."""
    state = session.state
    count = int(state.selected.sum())
    return SavedSelection(state.expression, state.generation, state.run, count, state.trajectories)


def shared_text(session: Session) -> str:
    """The expression, and after a `#` what it was evaluated on."""
    return written(present(session), session.store.dataset.hash)


def written(saved: SavedSelection, dataset_hash: str) -> str:
    """A saved selection as a line that `read` understands."""
    names = ", ".join(json.dumps(name, ensure_ascii=False) for name in saved.trajectories or ())
    return (
        f"{saved.expression}  # data set {dataset_hash[:_HASH_LENGTH]}, "
        f"generation {saved.generation}, run {saved.run}, {saved.count} instances"
        + (f" in {names}" if names else "")
    )


def read(text: str) -> Shared:
    """What was shared; text without facts is an expression alone."""
    found = _FACTS.search(text)
    if found is None:
        return Shared(text)
    expression, names = text[: found.start()], found["trajectories"]
    try:
        view = tuple(str(name) for name in json.loads(f"[{names}]")) if names else None
    except ValueError:
        return Shared(text)
    saved = SavedSelection(
        expression, int(found["generation"]), found["run"], int(found["count"]), view
    )
    return Shared(expression, found["hash"], saved)


def take(session: Session, text: str) -> State:
    """Select what was typed or pasted, on its run and trajectories where they exist here.

    Where a worker has to read columns for that, it is awaited. Tells where it means something else
    here. Raises RequestError for a selection of another data set, and for an expression that means
    nothing.
    """
    shared, own = read(text), session.store.dataset.hash
    if not own.startswith(shared.dataset):
        raise RequestError(
            f"this was selected on data set {shared.dataset}; here is {own[:_HASH_LENGTH]}"
        )
    state = session.state
    own_run = shared.saved.run if shared.saved and shared.saved.run in state.runs else None
    if (node := loading.lacks(session, own_run or state.run, shared.expression)) is not None:
        run, generation = loading.bound_for(session)
        return loading.expect(session, own_run or run, generation, text, node)
    return _taken(session, shared)


def arrive(session: Session, fresh: Store | None = None) -> State:
    """Turn to the awaited run (see `loading.arrive`), and select what was to be selected there;
    what is begun goes on.
    """
    awaited = session.state.awaited
    before = loading.arrive(session, fresh)
    if awaited is None or not awaited.text or before.run != awaited.run:
        return before
    if awaited.step is not None:
        state = walking.go(session, awaited.step, awaited.steps, at_once=True)
    else:
        state = _taken(session, read(awaited.text))
    return session.set(replace(state, brush=before.brush, operator=before.operator))


def _taken(session: Session, shared: Shared) -> State:
    if shared.saved is None:
        return session.select(shared.expression)
    before, known = session.state, session.store.instances.trajectory_names
    saved = shared.saved
    try:
        if saved.run in before.runs and saved.run != before.run:
            session.put_run(saved.run)
        if all(name in known for name in saved.trajectories or ()):
            session.put_trajectories(saved.trajectories)
        session.select(saved.expression)
    except RequestError:
        session.set(before)
        raise
    return _compared(session, before, saved)


def _compared(session: Session, before: State, saved: SavedSelection) -> State:
    """The state, with past and words as of one step: what moved with it, how it differs."""
    state, here = session.state, present(session)
    told = [state.message] if state.message else []
    if state.run != before.run:
        told.append(f"run {state.run}")
    if state.trajectories != before.trajectories:
        told.append(f"trajectories {', '.join(state.trajectories or ('all',))}")
    if replace(here, expression="") != replace(saved, expression=""):
        told.append(anew.differing(state, here.count, saved))
    made = replace(state, message="; ".join(told), past=before.past, future=before.future)
    if state.expression != before.expression:
        made = replace(made, past=(*before.past, before.expression)[-HISTORY:], future=())
    return session.set(made)
