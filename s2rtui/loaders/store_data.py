"""Feeds that read the store: when each is wanted, and how it is read."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import s2rstore
from s2rstore.reader import Store
from s2rtui.charts.instance.model import instance_input
from s2rtui.charts.overview.model import overview_rows
from s2rtui.charts.scene import RunAccuracies
from s2rtui.charts.shared.map_background import floor_plan_pixels
from s2rtui.loaders.loader import Fields, Key, LoadContext
from s2rtui.session import heatmaps, pending_target
from s2rtui.session.generations import INDEX_MEMORY
from s2rtui.session.provenance import about, heat_of, seen_of
from s2rtui.session.run_differences import other_run
from s2rtui.session.state import State


def wants_run(store: Store, state: State) -> Key | None:
    return None if state.awaited is None else (state.generation, state.awaited)


def read_run(store: Store, state: State, caller: LoadContext) -> Fields:
    """The columns of an awaited run; `store` is what it is open in where that is not this one."""
    awaited = state.awaited
    assert awaited is not None
    if awaited.generation == store.generation:
        pending_target.read(store, awaited, caller.wanted)
        return {}
    fresh = s2rstore.open(store.path, INDEX_MEMORY)
    try:
        run = awaited.run if awaited.run in fresh.runs else fresh.run().run
        pending_target.read(fresh, replace(awaited, run=run), caller.wanted)
    except BaseException:
        fresh.close()
        raise
    return {"store": fresh}


def wants_other(store: Store, state: State) -> Key | None:
    other = pending_target.lacking(store, state)
    return None if other is None else (state.generation, other)


def read_other(store: Store, state: State, caller: LoadContext) -> Fields:
    """The columns of the run that is compared with."""
    pending_target.read(
        store, replace(pending_target.here(state), run=str(other_run(state))), caller.wanted
    )
    return {}


def wants_columns(store: Store, state: State) -> Key:
    return (state.generation, state.run)


def read_columns(store: Store, state: State, caller: LoadContext) -> Fields:
    """What views draw of the present run later on, ahead of the keys that ask for it."""
    pending_target.read(store, pending_target.here(state), caller.wanted)
    return {}


def wants_rows(store: Store, state: State) -> Key:
    return (state.generation, state.runs)


def read_rows(store: Store, state: State, caller: LoadContext) -> Fields:
    """Run after run, so that only one more is held in memory than is looked at."""
    found = []
    for run in state.runs:
        found.append(overview_rows(store, [run]))
        if run != state.run:
            store.drop_run_columns(run)
    baseline = found[0][1] if found else math.nan
    return {"rows": tuple(row for rows, _ in found for row in rows), "baseline": baseline}


def wants_lines(store: Store, state: State) -> Key:
    return (state.generation, state.runs, state.side)


def read_lines(store: Store, state: State, caller: LoadContext) -> Fields:
    values = {run: store.accuracies(run, state.side) for run in state.runs}
    return {"lines": RunAccuracies(state.side, values)}


def wants_floor_plan(store: Store, state: State) -> Key | None:
    return (state.generation,) if store.dataset.floor_plan else None


def read_floor_plan(store: Store, state: State, caller: LoadContext) -> Fields:
    return {"floor_plan": floor_plan_pixels(str(store.floor_plan_path()))}


def wants_pictures(store: Store, state: State) -> Key | None:
    if state.cursor is None:
        return None
    return (state.generation, state.run, state.cursor, state.heat)


def read_pictures(store: Store, state: State, caller: LoadContext) -> Fields:
    assert state.cursor is not None
    pictures = instance_input(store, state.run, state.cursor, state.heat)
    return {"pictures": pictures, "pictures_source": about(state)}


def wants_grid(store: Store, state: State) -> Key | None:
    if state.heat is None or state.overlay == "off":
        return None
    return (heat_of(state),)


def read_grid(store: Store, state: State, caller: LoadContext) -> Fields:
    grid = _grid(store, state, caller)
    return {"floor_heat": grid, "floor_heat_source": None if grid is None else heat_of(state)}


def _grid(store: Store, state: State, caller: LoadContext) -> NDArray[np.float32] | None:
    assert state.heat is not None
    if state.overlay == "run":
        return heatmaps.run_grid(store, state.run, state.heat, state.aggregate)
    if state.overlay == "instance":
        if state.cursor is None:
            return None
        return heatmaps.instance_grid(store, state.run, state.heat, state.cursor)
    iids = evenly(np.flatnonzero(state.selected), heatmaps.MOST_GATHERED)
    if not iids.size:
        return None
    return heatmaps.gathered(store, state.run, state.heat, iids, state.aggregate, caller.progress)


def wants_seen(store: Store, state: State) -> Key | None:
    if not state.clip:
        return None
    return seen_of(state)


def read_seen(store: Store, state: State, caller: LoadContext) -> Fields:
    iids = evenly(np.flatnonzero(state.selected), heatmaps.MOST_GATHERED)
    seen = heatmaps.seen(store, state.run, state.side, iids, caller.progress)
    return {"seen_floor": seen, "seen_floor_source": seen_of(state)}


def evenly(iids: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """At most so many of the iids, in even steps."""
    if iids.size <= most:
        return iids
    return iids[np.linspace(0, iids.size - 1, most).round().astype(np.intp)]
