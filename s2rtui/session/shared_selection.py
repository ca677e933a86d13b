"""Share a selection as one line of text that another user can paste."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace

from s2rstore.errors import RequestError
from s2rstore.files.documents import parse_json
from s2rstore.language import parse
from s2rtui.session import navigation, selection, targets
from s2rtui.session.context import SessionContext
from s2rtui.session.state import State
from s2rtui.user_data.notebook import SavedSelection

_NAME = r'"(?:\\.|[^"\\])*"'
_FACTS = re.compile(
    r"\s+# data set (?P<hash>[0-9a-f]+), generation (?P<generation>\d+), "
    r"run (?P<run>.+?), (?P<count>\d+) (?P<new>new )?instances"
    rf"(?: in (?P<trajectories>{_NAME}(?:, {_NAME})*))?\s*\Z"
)
_HASH_LENGTH = 12


@dataclass(frozen=True, slots=True)
class Shared:
    """An expression and, if it was shared with them, the store's identity and its evaluation."""

    expression: str
    dataset: str = ""
    saved: SavedSelection | None = None


def current_selection(state: State) -> SavedSelection:
    """The state's selection with the run, generation and count of its evaluation."""
    count = int(state.selected.sum())
    return SavedSelection(
        state.expression,
        state.generation,
        state.run,
        count,
        state.trajectories,
        with_trained=state.with_trained,
    )


def shared_text(saved: SavedSelection, identity: str) -> str:
    """One line that `parse_shared` reads: the expression, and after a `#` its evaluation.

    `identity` is the identity of the store, which appending instances does not change. Without the
    word `new`, trained instances were included.
    """
    names = ", ".join(json.dumps(name, ensure_ascii=False) for name in saved.trajectories or ())
    return (
        f"{saved.expression}  # data set {identity[:_HASH_LENGTH]}, "
        f"generation {saved.generation}, run {saved.run}, "
        f"{saved.count} {'' if saved.with_trained else 'new '}instances"
        + (f" in {names}" if names else "")
    )


def parse_shared(text: str) -> Shared:
    """Read a shared line; text without an evaluation is an expression alone."""
    match = _FACTS.search(text)
    if match is None:
        return Shared(text)
    expression, names = text[: match.start()], match["trajectories"]
    trajectories = None
    if names:
        try:
            parsed = parse_json(f"[{names}]", "trajectories")
        except RequestError:
            return Shared(text)
        trajectories = tuple(str(name) for name in parsed)
    saved = SavedSelection(
        expression, int(match["generation"]), match["run"], int(match["count"]), trajectories,
        with_trained=match["new"] is None,
    )  # fmt: skip
    return Shared(expression, match["hash"], saved)


def select_text(context: SessionContext, state: State, text: str) -> State:
    """Select a typed or pasted line, on the run and trajectories in it if they exist here.

    The message says how the result differs from the shared one. Raises RequestError for a
    selection of another data set and for an invalid expression.
    """
    shared, identity = parse_shared(text), context.store.identity
    if not identity.startswith(shared.dataset):
        raise RequestError(
            f"the selection belongs to data set {shared.dataset}; "
            f"the open store holds {identity[:_HASH_LENGTH]}"
        )
    if shared.saved is None:
        return selection.select(context, state, shared.expression, "replace")
    saved, known = shared.saved, context.store.instances.trajectory_names
    node = parse(saved.expression)
    place = targets.final(state)
    place = replace(place, with_trained=saved.with_trained)
    if saved.run in state.runs:
        place = replace(place, run=saved.run)
    if all(name in known for name in saved.trajectories or ()):
        place = replace(place, trajectories=saved.trajectories)
    target = targets.with_expression(state, place, node)
    return navigation.select_at(context, state, replace(target, saved=saved))
