"""Scenes without the application: the state that options describe, and the data of the views."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.files.planned_poses import read_planned_poses
from s2rstore.heatmap_kinds import NO_HEAT
from s2rstore.language import Node, fields
from s2rstore.reader import NETWORK_KINDS
from s2rstore.records import Side, needs_network
from s2rtui.charts.scene import LoadedData, Scene
from s2rtui.charts.view import View
from s2rtui.loaders import LOADERS, Fields, LoadContext
from s2rtui.session import error_groups, instance_list
from s2rtui.session.heatmaps import heatmap_choices, require_floor
from s2rtui.session.map_values import SHIFT, require_available
from s2rtui.session.session import Session
from s2rtui.session.state import Aggregate, HeatChoice, MapMode, Overlay, Picture, State
from s2rtui.user_data.notebook import ReadNotebook


@dataclass(frozen=True, slots=True)
class SceneOptions:
    """Options of `show`, `export` and `report`; None selects the default.

    `with_trained` includes the instances that the models were trained on. `heat` is KIND[:MODE];
    `overlay` names the instances whose heat is on the map; `sort` is a column of the list or of the
    rooms view, `group_by` the grouping of the rooms view, `images` what the sheet shows.
    `poses` is a CSV file of planned poses, which the map shows.
    """

    select: str | Node = "all"
    run: str | None = None
    trajectories: tuple[str, ...] | None = None
    iid: int | None = None
    other: str | None = None
    with_trained: bool = False
    heat: str | None = None
    side: Side | None = None
    overlay: Overlay | None = None
    aggregate: Aggregate = "mean"
    map_mode: MapMode = "colour"
    map_value: str = SHIFT
    images: Picture = "real"
    clip: bool = False
    room_names: bool = False
    sort: str | None = None
    ascending: bool = False
    group_by: str | None = None
    history: Path | None = None
    poses: Path | None = None


@contextmanager
def open_scene(
    path: Path, options: SceneOptions, *views: View, generation: int | None = None
) -> Iterator[Scene]:
    """Open a store, by default the published generation, and load the scene of some views.

    Raises RequestError.

    The scene has a cursor if an instance is requested or a view shows a single instance.
    """
    session = Session(
        path, options.run, ReadNotebook, options.history, options.with_trained, generation
    )
    try:
        for view in views:
            view.require_available(session.store)
        apply_options(session, options, *views)
        cursor = options.iid is not None or not views or any(view.single_instance for view in views)
        yield load_scene(session, *views, cursor=cursor)
    finally:
        session.close()


def load_scene(session: Session, *views: View, cursor: bool = True) -> Scene:
    """Return the scene of a session, with the data that the views load in the background."""
    store, state = session.store, session.state
    centre = next((view.name for view in views if view.pane == "centre"), state.centre)
    state = replace(state, cursor=state.cursor if cursor else None, centre=centre)
    needed = {name for view in views for name in view.loads}
    fields: Fields = {}
    for loader in LOADERS:
        if loader.name in needed and loader.request_key(store, state) is not None:
            fields |= loader.read(store, state, LoadContext())
    if state.overlay != "off" and "floor_heat" in fields and fields["floor_heat"] is None:
        label = state.heat.label if state.heat else ""
        if state.heat:
            require_floor(store, state.run, state.heat)
        raise RequestError(
            f"--heat {label}: run {state.run} has no stored map of it; use --on selection"
        )
    return Scene(store, state, LoadedData(**fields), session.notes)


def apply_options(session: Session, options: SceneOptions, *views: View) -> State:
    """Set the state of a session to the options and return it. Raises RequestError.

    `views` are those that are shown, which decide what can be sorted by; by default all.
    """
    known = session.store.instances.trajectory_names
    for name in options.trajectories or ():
        if name not in known:
            raise RequestError(f"--trajectory {name}: must be one of {', '.join(known)}")
    session.set_state(
        replace(session.state, trajectories=options.trajectories, with_trained=options.with_trained)
    )
    state = session.select(options.select)
    overlay = options.overlay or ("run" if options.heat not in (None, NO_HEAT) else "off")
    if options.heat == NO_HEAT and overlay != "off":
        raise RequestError(f"--on {overlay}: --heat none leaves no heat for the map")
    heat = _heat(session, state, options)
    if options.images == "heat" and (heat is None or heat.kind == NO_HEAT):
        reason = "not with --heat none"
        if heat is None:
            reason = f"run {state.run} has no heatmaps" if state.run else session.store.no_run
        raise RequestError(f"--images heat: {reason}")
    if options.images != "real" and views and all(view.name != "sheet" for view in views):
        raise RequestError(f"--images {options.images}: only view sheet shows them")
    iid, other = options.iid, options.other
    if iid is not None and not 0 <= iid < state.base.size:
        raise RequestError(f"--iid {iid}: must be 0 to {state.base.size - 1}")
    others = [run for run in state.runs if run != state.run]
    if other is not None and other not in others:
        names = ", ".join(others) or "there is none"
        raise RequestError(f"--with {other}: must be another run ({names})")
    require_available(session.store, state.run, options.map_value)
    sort, group_sort = _sort_columns(session, state, options.sort, {view.name for view in views})
    if iid is None and state.chosen.any():
        iid = state.cursor
    return session.set_state(
        replace(
            state,
            heat=heat,
            overlay=overlay,
            aggregate=options.aggregate,
            map_mode=options.map_mode,
            map_value=options.map_value,
            images=replace(state.images, picture=options.images),
            dims_unseen_floor=options.clip,
            room_names=options.room_names,
            planned=read_planned_poses(options.poses) if options.poses else (),
            cursor=iid,
            compared_run=other,
            sort=sort,
            descending=not options.ascending,
            grouping=options.group_by or state.grouping,
            group_sort=group_sort,
            group_descending=not options.ascending,
            past=(),
            message="",
        )
    )


def _sort_columns(
    session: Session, state: State, name: str | None, views: set[str]
) -> tuple[str, str]:
    """The columns that sort the list and the groups; unchanged where `name` is None.

    Raises RequestError for a column that the sortable ones of `views` (by default all) lack.
    """
    if name is None:
        return state.sort, state.group_sort
    sorted_views = views & {"list", "rooms"} or {"list", "rooms"}
    columns: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()
    if "list" in sorted_views:
        columns = instance_list.columns(session.store, session.notes)
    if "rooms" in sorted_views:
        groups = error_groups.COLUMN_NAMES
    column = fields.of_name(name)
    if column not in columns and name not in groups:
        raise RequestError(f"--sort {name}: must be one of {', '.join((*columns, *groups))}")
    return (
        column if column in columns else state.sort,
        name if name in groups else state.group_sort,
    )


def _heat(session: Session, state: State, options: SceneOptions) -> HeatChoice | None:
    known = heatmap_choices(session.store, state.run)
    if not known and options.heat is None and options.side in (None, state.side):
        return None
    if options.heat == NO_HEAT:
        return HeatChoice(NO_HEAT, None, options.side or state.side)
    kind, _, mode = (options.heat or "").partition(":")
    matches = [pair for pair in known if kind in ("", pair[0]) and mode in ("", pair[1])]
    if not matches:
        if kind in NETWORK_KINDS and session.store.run(state.run).is_imported:
            raise RequestError(needs_network(state.run, f"--heat {kind}"))
        available = ", ".join(f"{k}:{m}" if m else k for k, m in [*known, (NO_HEAT, None)])
        option = f"--heat {options.heat}" if options.heat else f"--side {options.side}"
        raise RequestError(f"{option}: run {state.run} has the heatmaps {available}")
    return HeatChoice(*matches[0], options.side or state.side)
