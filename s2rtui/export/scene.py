"""A scene without an application: the state that options describe, with all that a view needs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.records import Side
from s2rtui.charts.view import Resources, Scene, View
from s2rtui.loaders import LOADERS, Fields
from s2rtui.session import HeatChoice, Session, State, instance_list
from s2rtui.session.heatmaps import heatmap_choices
from s2rtui.session.state import Aggregate, MapMode, Overlay
from s2rtui.user_data.notebook import ReadNotebook


@dataclass(frozen=True, slots=True)
class SceneOptions:
    """What the options of `show`, `export` and `report` ask for; None takes the usual.

    `heat` is KIND[:MODE]; `overlay` whose heat lies on the map; `sort` a column of the list.
    """

    select: str = "all"
    run: str | None = None
    trajectories: tuple[str, ...] | None = None
    iid: int | None = None
    other: str | None = None
    heat: str | None = None
    side: Side | None = None
    overlay: Overlay | None = None
    aggregate: Aggregate = "mean"
    map_mode: MapMode = "colour"
    clip: bool = False
    room_names: bool = False
    sort: str | None = None
    ascending: bool = False
    history: Path | None = None


@contextmanager
def staged(path: Path, wanted: SceneOptions, *views: View) -> Iterator[Scene]:
    """The scene of some views; the store is closed afterwards. Raises RequestError.

    An instance that nobody asked for is no cursor, except where a view shows one instance.
    """
    session = Session(path, wanted.run, ReadNotebook, wanted.history)
    try:
        described(session, wanted)
        cursor = wanted.iid is not None or not views or any(view.one for view in views)
        yield fed(session, *views, cursor=cursor)
    finally:
        session.close()


def fed(session: Session, *views: View, cursor: bool = True) -> Scene:
    """The session's scene, with its cursor or without, and what workers bring for some views."""
    store, state = session.store, session.state
    state = state if cursor else replace(state, cursor=None)
    needed = {name for view in views for name in view.feeds}
    fields: Fields = {}
    for feed in LOADERS:
        if feed.name in needed and feed.request_key(store, state) is not None:
            fields |= feed.read(store, state, _UncancelledContext())
    if state.overlay != "off" and "grid" in fields and fields["grid"] is None:
        told = f"run {state.run} has no such map; --on selection gathers one"
        raise RequestError(f"--heat {state.heat.label if state.heat else ''}: {told}")
    return Scene(store, state, Resources(**fields), session.notes)


def described(session: Session, wanted: SceneOptions) -> State:
    """The session's state with what is wanted."""
    known = session.store.instances.trajectory_names
    for name in wanted.trajectories or ():
        if name not in known:
            raise RequestError(f"--trajectory {name}: one of {', '.join(known)}")
    session.set_state(replace(session.state, trajectories=wanted.trajectories))
    state = session.select(wanted.select)
    overlay = wanted.overlay or ("run" if wanted.heat else "off")
    state = replace(
        state,
        heat=_heat(session, state, wanted),
        overlay=overlay,
        aggregate=wanted.aggregate,
        map_mode=wanted.map_mode,
        clip=wanted.clip,
        room_names=wanted.room_names,
        cursor=_cursor(state, wanted.iid),
        other=_other(state, wanted.other),
        descending=not wanted.ascending,
        past=(),
        message="",
    )
    if wanted.sort is not None:
        known = instance_list.columns(session.notes)
        if wanted.sort not in known:
            raise RequestError(f"--sort {wanted.sort}: one of {', '.join(known)}")
        state = replace(state, sort=wanted.sort)
    return session.set_state(state)


def _cursor(state: State, iid: int | None) -> int | None:
    if iid is None:
        return state.cursor if state.selected.any() else None
    if not 0 <= iid < state.base.size:
        raise RequestError(f"--iid {iid}: 0 .. {state.base.size - 1}")
    return iid


def _other(state: State, name: str | None) -> str | None:
    if name is not None and (name not in state.runs or name == state.run):
        others = ", ".join(run for run in state.runs if run != state.run)
        raise RequestError(f"--with {name}: one of {others or 'no other run'}")
    return name


def _heat(session: Session, state: State, wanted: SceneOptions) -> HeatChoice | None:
    known = heatmap_choices(session.store, state.run)
    if not known and wanted.heat is None and wanted.side in (None, state.side):
        return None
    kind, _, mode = (wanted.heat or "").partition(":")
    found = [pair for pair in known if kind in ("", pair[0]) and mode in ("", pair[1])]
    if not found:
        listed = ", ".join(f"{k}:{m}" if m else k for k, m in known) or "none"
        asked = f"--heat {wanted.heat}" if wanted.heat else f"--side {wanted.side}"
        raise RequestError(f"{asked}: run {state.run} has the heatmaps {listed}")
    return HeatChoice(*found[0], wanted.side or state.side)


class _UncancelledContext:
    """A request that is never cancelled."""

    def is_wanted(self) -> bool:
        return True

    def report_progress(self, share: float) -> bool:
        return True

    def publish(self, fields: Fields) -> None:
        return None
