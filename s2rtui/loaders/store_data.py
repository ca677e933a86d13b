"""Loaders that read the store and its history: the key of each request, and how it is read."""

from __future__ import annotations

import math
from dataclasses import astuple, replace
from functools import lru_cache
from io import BytesIO
from pathlib import Path

import numpy as np

import s2rstore
from s2rstore.arrays.row_array import evenly_spaced
from s2rstore.errors import RequestError
from s2rstore.files.image_header import floor_plan_bytes
from s2rstore.findings import find_all
from s2rstore.findings.groups import group_errors, groups_of
from s2rstore.gap_history import reader
from s2rstore.index.population import Population
from s2rstore.reader import Store
from s2rstore.records import NO_RUN
from s2rtui.canvas import Pixels
from s2rtui.charts.overview import overview_rows, translator_rows
from s2rtui.charts.scene import LoadedGroups, LoadedModel, RunAccuracies, model_source
from s2rtui.charts.shared.instance_input import instance_input
from s2rtui.charts.sheet import sheet_page
from s2rtui.charts.view import StatisticsView
from s2rtui.drawing.floor import plan_tones
from s2rtui.loaders.loader import Fields, Key, LoadContext, Loader
from s2rtui.session import error_groups, heatmaps, images, provenance, targets
from s2rtui.session.provenance import (
    heat_provenance,
    instance_provenance,
    visible_floor_key,
)
from s2rtui.session.run_comparison import other_run
from s2rtui.session.session import INDEX_MEMORY
from s2rtui.session.state import State


def run_key(store: Store, state: State) -> Key | None:
    return None if state.pending is None else (state.generation, state.pending)


def read_run(store: Store, state: State, context: LoadContext) -> Fields:
    """The columns of the pending run; the field `store` is a newer generation, opened for it."""
    pending = state.pending
    assert pending is not None
    if pending.generation == store.generation:
        targets.load_columns(store, pending, context.is_current)
        return {}
    fresh = s2rstore.open(store.path, INDEX_MEMORY)
    try:
        run = pending.run if pending.run in fresh.runs else fresh.run().run
        targets.load_columns(fresh, replace(pending, run=run), context.is_current)
    except BaseException:
        fresh.close()
        raise
    return {"store": fresh}


def other_key(store: Store, state: State) -> Key | None:
    other = other_run(state) if state.centre == "compare" else None
    if other is None or targets.run_is_loaded(store, other):
        return None
    return (state.generation, other)


def read_other(store: Store, state: State, context: LoadContext) -> Fields:
    """The columns of the compared run."""
    target = replace(targets.place_of(state), run=str(other_run(state)))
    targets.load_columns(store, target, context.is_current)
    return {}


def read_columns(store: Store, state: State, context: LoadContext) -> Fields:
    """The columns of the present run that views may need next."""
    targets.load_columns(store, targets.place_of(state), context.is_current)
    return {}


def read_rows(store: Store, state: State, context: LoadContext) -> Fields:
    """Read one run after another; one run besides the present one is in memory at a time."""
    results = []
    for run in state.runs:
        results.append(overview_rows(store, [run]))
        if run != state.run:
            store.drop_run_columns(run)
    baseline = results[0][1] if results else math.nan
    rows = tuple(row for rows, _ in results for row in rows)
    return {"rows": rows, "baseline": baseline, "translators": translator_rows(store)}


def lines_key(store: Store, state: State) -> Key:
    return (state.generation, state.runs, state.side, state.with_trained)


def read_lines(store: Store, state: State, context: LoadContext) -> Fields:
    """The accuracies of every run, NaN where the run's model was trained on the instance.

    Where trained instances are included, `trained` marks those of any run instead.
    """
    values, marked = {}, np.zeros(len(store.instances), dtype=np.bool_)
    for run in state.runs:
        accuracies, trained = store.accuracies(run, state.side), store.trained_instances(run)
        if state.population.with_trained:
            marked |= trained
        else:
            accuracies[trained] = np.nan
        values[run] = accuracies
    return {"lines": RunAccuracies(state.side, values, marked if marked.any() else None)}


def floor_plan_key(store: Store, state: State) -> Key | None:
    return (state.generation,) if store.dataset.floor_plan else None


def read_floor_plan(store: Store, state: State, context: LoadContext) -> Fields:
    """Read the floor plan and detect its walls, which are cached for the maps."""
    plan, width = floor_plan_pixels(str(store.floor_plan_path())), store.dataset.bounds.width
    if width > 0:
        plan_tones(plan, width)
    return {"floor_plan": plan}


@lru_cache(maxsize=4)
def floor_plan_pixels(path: str) -> Pixels:
    """The floor plan (H, W, 3). Raises RequestError where it cannot be decoded."""
    from PIL import Image

    content = floor_plan_bytes(Path(path))
    try:
        with Image.open(BytesIO(content), formats=["PNG"]) as picture:
            return np.asarray(picture.convert("RGB"))
    except (OSError, ValueError, SyntaxError) as error:  # Pillow: damage is any of these
        raise RequestError(f"{path}: the floor plan is damaged ({error})") from error


def pictures_key(store: Store, state: State) -> Key | None:
    if state.cursor is None:
        return None
    is_near = state.viewport_of("instance") is not None
    label = state.chosen_row("objects")
    return (*astuple(instance_provenance(state)), state.with_trained, is_near, label)


def read_pictures(store: Store, state: State, context: LoadContext) -> Fields:
    assert state.cursor is not None
    population = Population(with_trained=state.with_trained)
    is_near = state.viewport_of("instance") is not None
    pictures = instance_input(
        store, state.run, state.cursor, state.shown_heat, population, is_near,
        state.chosen_row("objects"),
    )  # fmt: skip
    return {"pictures": pictures, "pictures_source": instance_provenance(state)}


def sheet_key(store: Store, state: State) -> Key | None:
    return images.page_key(store, state) if state.centre == "sheet" else None


def read_sheet(store: Store, state: State, context: LoadContext) -> Fields:
    """The thumbnails of the page of the sheet."""
    return {"sheet": sheet_page(store, state)}


def grid_key(store: Store, state: State) -> Key | None:
    if state.shown_heat is None or state.overlay == "off":
        return None
    return (heat_provenance(state),)


def read_grid(store: Store, state: State, context: LoadContext) -> Fields:
    """The heat of the run, of the instance, or of at most `MAX_GATHERED` selected instances."""
    assert state.heat is not None
    grid, heat = None, (store, state.run, state.heat)
    iids = evenly_spaced(np.flatnonzero(state.selected), heatmaps.MAX_GATHERED)
    if state.overlay == "run":
        grid = heatmaps.run_grid(*heat, state.aggregate)
    elif state.overlay == "instance" and state.cursor is not None:
        grid = heatmaps.instance_grid(*heat, state.cursor)
    elif state.overlay == "selection" and iids.size:
        grid = heatmaps.selection_grid(*heat, iids, state.aggregate, context.report_progress)
    source = None if grid is None else heat_provenance(state)
    return {"floor_heat": grid, "floor_heat_source": source}


def read_seen(store: Store, state: State, context: LoadContext) -> Fields:
    iids = evenly_spaced(np.flatnonzero(state.selected), heatmaps.MAX_GATHERED)
    seen = heatmaps.visible_floor(store, state.run, state.side, iids, context.report_progress)
    return {"seen_floor": seen, "seen_floor_source": visible_floor_key(state)}


def read_history(store: Store, state: State, context: LoadContext) -> Fields:
    """Raises RequestError for a file that is no history."""
    assert state.history is not None
    return {"history": reader.read(state.history.path)}


def groups_key(store: Store, state: State) -> Key | None:
    if not store.has_poses or state.grouping == error_groups.COUNTS or state.run == NO_RUN:
        return None
    return provenance.groups_key(state, state.grouping)


def read_groups(store: Store, state: State, context: LoadContext) -> Fields:
    """The errors of the groups of the rooms view, over the base population."""
    return {"groups": _groups(store, state, state.grouping)}


def cells_key(store: Store, state: State) -> Key | None:
    if not store.has_poses or state.centre != "pivot" or state.run == NO_RUN:
        return None
    return provenance.groups_key(state, error_groups.pivot_grouping(state))


def read_cells(store: Store, state: State, context: LoadContext) -> Fields:
    """The errors of the cells of the pivot, over the base population."""
    return {"cells": _groups(store, state, error_groups.pivot_grouping(state))}


def _groups(store: Store, state: State, grouping: str) -> LoadedGroups:
    grouped = groups_of(store, grouping)
    rows = group_errors(store, state.run, grouped, state.base)
    return LoadedGroups(provenance.groups_key(state, grouping), grouped, rows)


def findings_key(store: Store, state: State) -> Key | None:
    if not store.has_poses or state.run == NO_RUN:
        return None
    return (state.generation, state.run, state.history)


def read_findings(store: Store, state: State, context: LoadContext) -> Fields:
    """Everything that the store shows about the present run."""
    history = state.history.path if state.history else None
    return {"findings": find_all(store, state.run, history, lambda share: context.is_current())}


def model_loader(view: StatisticsView) -> Loader:
    """The loader of the numbers of a statistical view, while it is shown."""

    def request_key(store: Store, state: State) -> Key | None:
        is_shown = view.name in (state.tab, state.centre) and not view.unavailable(store)
        can_be_computed = state.run != NO_RUN or not view.needs_run
        return model_source(state) if is_shown and can_be_computed else None

    def read(store: Store, state: State, context: LoadContext) -> Fields:
        model = view.model(store, state)
        return {"models": {view.name: LoadedModel(model_source(state), model)}}

    return Loader(view.name, request_key, read)
