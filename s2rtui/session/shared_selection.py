"""A selection as one line of text that another user can paste."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace

from s2rstore.errors import RequestError
from s2rstore.files.input_files import parse_json
from s2rstore.language import parse, to_text
from s2rtui.session import navigation, pending_target
from s2rtui.session.session import Session
from s2rtui.session.state import State
from s2rtui.user_data.notebook import SavedSelection

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
        view = (
            tuple(str(name) for name in parse_json(f"[{names}]", "trajectories")) if names else None
        )
    except RequestError:
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
    if shared.saved is None:
        return navigation.select(session, shared.expression)
    saved, known = shared.saved, session.store.instances.trajectory_names
    state, text = session.state, to_text(parse(saved.expression))
    there = pending_target.step(state, pending_target.bound(state), text)
    if saved.run in state.runs:
        there = replace(there, run=saved.run)
    if all(name in known for name in saved.trajectories or ()):
        there = replace(there, trajectories=saved.trajectories)
    return navigation.take(session, replace(there, saved=saved))
