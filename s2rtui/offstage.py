"""A scene without an application: the state that options describe, with all that a view needs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rtui.feeds import FEEDS, Fields
from s2rtui.notebook import Notebook
from s2rtui.session import HeatChoice, Session, State
from s2rtui.session.heat import choices
from s2rtui.views import Resources, Scene

_NEEDS = {"instance": ("pictures",), "overview": ("rows", "lines"), "map": ("floor plan",)}


@dataclass(frozen=True, slots=True)
class Wanted:
    """What the options of `show` and `export` ask for."""

    select: str = "all"
    run: str | None = None
    iid: int | None = None
    other: str | None = None
    heat: str | None = None


@contextmanager
def staged(path: Path, wanted: Wanted, view: str) -> Iterator[Scene]:
    """The scene of one view; the store is closed afterwards. Raises RequestError."""
    session = Session(path, wanted.run, Notebook)
    try:
        state = described(session, wanted)
        fields: Fields = {}
        for feed in FEEDS:
            if feed.name in _NEEDS.get(view, ()) and feed.wants(session.store, state) is not None:
                fields |= feed.read(session.store, state, _Patient())
        yield Scene(session.store, state, Resources(**fields), session.notes)
    finally:
        session.close()


def described(session: Session, wanted: Wanted) -> State:
    """The session's state with what is wanted."""
    session.select(wanted.select)
    state = session.state
    if wanted.heat is not None:
        state = replace(state, heat=_heat(session.store, state, wanted.heat))
    if wanted.iid is not None:
        if not 0 <= wanted.iid < state.base.size:
            raise RequestError(f"--iid {wanted.iid}: 0 .. {state.base.size - 1}")
        state = replace(state, cursor=wanted.iid)
    if wanted.other is not None:
        if wanted.other not in state.runs:
            raise RequestError(f"--with {wanted.other}: one of {', '.join(state.runs)}")
        state = replace(state, other=wanted.other)
    return session.set(state)


def _heat(store: Store, state: State, text: str) -> HeatChoice:
    kind, _, mode = text.partition(":")
    known = choices(store, state.run)
    found = [pair for pair in known if pair[0] == kind and (not mode or pair[1] == mode)]
    if not found:
        listed = ", ".join(f"{k}:{m}" if m else k for k, m in known) or "none"
        raise RequestError(f"--heat {text}: run {state.run} has {listed}")
    return HeatChoice(*found[0], state.side)


class _Patient:
    """Somebody who waits for the whole answer."""

    def wanted(self) -> bool:
        return True

    def progress(self, share: float) -> bool:
        return True

    def bring(self, fields: Fields) -> None:
        return None
