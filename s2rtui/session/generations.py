"""From the generation that is open to a newer one."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import s2rstore
from s2rstore.reader import Store
from s2rtui.session import navigation, pending_target
from s2rtui.session.state import State

if TYPE_CHECKING:
    from s2rtui.session.session import Session

INDEX_MEMORY = "128MB"
"""Columns are read one by one, so the index itself needs little."""


def computed(store: Store) -> tuple[str, ...]:
    """The runs that can be looked at."""
    return tuple(name for name, record in store.runs.items() if record.key)


def move_on(session: Session) -> State:
    """Open the newest generation, keeping run and expression where they still exist."""
    store, state = session.store, session.state
    if store.latest_generation() == store.generation:
        return session.tell("this is the newest generation")
    if session.waits and len(store.instances) > pending_target.AT_ONCE:
        there = replace(pending_target.bound(state), generation=store.latest_generation())
        return navigation.move(session, there)
    return enter(session, s2rstore.open(store.path, INDEX_MEMORY))


def enter(session: Session, fresh: Store) -> State:
    """Go on in a newer generation, where the session is bound for; what is begun goes on there."""
    old, state, runs = session.store, session.state, computed(fresh)
    if fresh.dataset.hash != old.dataset.hash or not runs:
        fresh.close()
        pending_target.give_up(session)
        what = "has no computed run" if not runs else "holds another data set"
        return session.tell(f"the newest generation {what}: open it anew", is_error=True)
    there = pending_target.bound(state)
    base = replace(
        state,
        generation=fresh.generation,
        newest=fresh.generation,
        runs=runs,
        run=state.run if state.run in runs else runs[0],
        other=state.other if state.other in runs else None,
    )
    session.store = fresh
    try:
        made = navigation.settled(session, base, there)
    except BaseException:
        session.store = old
        fresh.close()
        raise
    session.retire(old)
    if there.run in runs:
        made = navigation.begun(state, made)
    told = (f"generation {fresh.generation}", made.message)
    return session.set(replace(made, message="; ".join(part for part in told if part)))
