"""An instance of a store as numbers, images and notes, which the instance view shows."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import NotComputedError
from s2rstore.geometry import camera
from s2rstore.heatmap_kinds import heatmap_facts
from s2rstore.index.columns import RunColumns
from s2rstore.index.population import NEW_INSTANCES, Population
from s2rstore.metrics import nearest_neighbours
from s2rstore.metrics.heatmap_scores import trust_line
from s2rstore.metrics.object_gains import instance_gains
from s2rstore.reader import Store
from s2rstore.records import NO_RUN, SIDES, SPLITS, Side
from s2rstore.security.printable_text import printable
from s2rtui.charts.shared.instance import (
    InstanceInput,
    PoseNumbers,
    SideView,
    heat_fields,
    truth_fields,
)
from s2rtui.session.model_input import ModelInput, model_input, stored_image
from s2rtui.session.population_values import population_ranks
from s2rtui.session.state import HeatChoice

NEIGHBOURS = 5
"""Number of most similar instances that are listed and selected."""
_PLACES = 4
"""Regions whose metres are listed."""
_ROWS = ("top", "", "bottom")
_COLUMNS = ("left", "", "right")


def instance_input(
    store: Store,
    run: str,
    iid: int,
    heat: HeatChoice | None,
    population: Population = NEW_INSTANCES,
    at_source: bool = False,
    label: str | None = None,
) -> InstanceInput:
    """Images, heat and numbers of one instance; reads frames and heatmaps.

    `population` holds the instances that may be named as similar to this one. A note says so where
    the heat of this instance is not computed. at_source: whether images have the size of their
    source, where it is stored. label: a class of objects that is marked.
    """
    if not store.has_poses:
        return _image_input(store, iid, at_source)
    truth = store.instances
    room = truth.room[iid]
    trajectory = truth.trajectory_names[truth.trajectory[iid]]
    shown = store.displayed_run(run)
    sim, real = (model_input(store, shown, side, iid, at_source) for side in SIDES)
    missing: tuple[tuple[str, str], ...] = ()
    heats: dict[Side, NDArray[np.float32] | None] = dict.fromkeys(SIDES)
    try:
        if heat is not None:
            heats |= {s: store.heatmap(run, heat.kind, s, iid, heat.mode) for s in SIDES}
    except NotComputedError as error:
        missing = (("heat", str(error)),)
        if not all(store.is_imaged(shown.domain(side), iid) for side in SIDES):
            missing = (("heat", f"needs images in {shown.sim_domain} and {shown.real_domain}"),)
    marks: dict[Side, dict[str, Any]] = {"sim": {}, "real": {}}
    if label is not None:
        marks = {side: _object_mark(store, run, side, iid, label) for side in SIDES}
    harm = _harm_note(heat, heats["real"], float(store.run_columns(run).real.error[iid]))
    return InstanceInput(
        iid=iid,
        sim=_side(store, run, iid, "sim", heats["sim"], sim, **marks["sim"]),
        real=_side(store, run, iid, "real", heats["real"], real, **marks["real"]),
        **truth_fields(store, run, iid),
        **heat_fields(store, run, None if missing else heat),
        notes=(
            *missing,
            *_mark_note(label, marks),
            *_heat_note(store, run, None if missing else heat),
            *harm,
            *(_objects_note(store, run, iid) if harm else ()),
            ("where", f"{trajectory} {truth.seq[iid]}, {_named(truth.room_names, int(room))}"),
            *_pair_note(store, iid),
            *_predicted_notes(store, run, iid, population),
            *sim.notes,
            *real.notes,
        ),
    )


def _predicted_notes(
    store: Store, run: str, iid: int, population: Population
) -> list[tuple[str, str]]:
    """Split, gap, ranks and neighbours of an instance in a run, or why there are none."""
    if run == NO_RUN:
        return [("predictions", f"none: {store.missing_run}")]
    columns = store.run_columns(run)
    numbers = [("gap", _gap(columns, iid)), ("ranks", _ranks(store, run, iid, population))]
    neighbours = _neighbours(store, run, iid, population)
    return [*_split_note(columns, iid), *numbers, *neighbours]


def _heat_note(store: Store, run: str, heat: HeatChoice | None) -> list[tuple[str, str]]:
    """What the shown heatmap means and how far it can be trusted; nothing without one."""
    text = trust_line(store, run, heat.kind, heat.mode) if heat is not None else ""
    return [("heat", text)] if text else []


def _harm_note(
    choice: HeatChoice | None, heat: NDArray[np.float32] | None, error: float
) -> list[tuple[str, str]]:
    """A line on how many metres each changed part of the real image costs; empty for other heat.

    Parts in the same place of the image are added up, the largest sums first; fine heat has no
    parts. Positive metres make the estimate worse. `error` is the real error in metres, of which
    the line says what the sum of the heat leaves.
    """
    if choice is None or heat is None or not heatmap_facts(choice.kind).sums_up:
        return []
    if choice.mode not in (None, "position"):  # the others are radians and loss
        return []
    values = np.nan_to_num(np.asarray(heat, dtype=np.float64))
    total = f"changes cost {values.sum():+.2f} m"
    if values.any() and math.isfinite(error):
        total += f", without these {error:.2f} -> {max(0.0, error - values.sum()):.2f} m"
    if choice.kind == "harm_fine":
        return [("harm", total)]
    from scipy import ndimage  # not when the program starts

    gains: dict[str, float] = {}
    numbers, count = ndimage.label(values, np.ones((3, 3)))  # touching by sides or corners
    for region in (numbers == number for number in range(1, count + 1)):
        place = place_in_image(region)
        gains[place] = gains.get(place, 0.0) + float(values[region].sum())
    places = sorted(gains, key=lambda place: -abs(gains[place]))
    shown = [f"{gains[place]:+.2f} m {place}" for place in places[:_PLACES]]
    more = f", {len(places) - _PLACES} more" if len(places) > _PLACES else ""
    return [("harm", f"{total}: {', '.join(shown)}{more}" if shown else "no changed part")]


def _objects_note(store: Store, run: str, iid: int) -> list[tuple[str, str]]:
    """The labelled objects that cost or save the most metres; nothing without any."""
    gains = [(name, gain) for name, gain in instance_gains(store, run, iid) if abs(gain) >= 0.005]
    shown = [f"{gain:+.2f} m {name}" for name, gain in gains[:_PLACES]]
    more = [f"{len(gains) - _PLACES} more"] if len(gains) > _PLACES else []
    return [("objects", ", ".join([*shown, *more]))] if shown else []


def _split_note(columns: RunColumns, iid: int) -> list[tuple[str, str]]:
    """The split of an instance that the run's model was trained on; else nothing."""
    if not columns.trained[iid]:
        return []
    return [("split", f"{SPLITS[columns.split[iid]]}: the model was trained on it")]


def _pair_note(store: Store, iid: int) -> list[tuple[str, str]]:
    """The offset of a loose pair, whose images show the scene from two poses; else nothing."""
    offset = store.pair_offset(iid)
    return [("pair", f"sim pose {offset} from the real one")] if offset else []


def _image_input(store: Store, iid: int, at_source: bool) -> InstanceInput:
    """The images of an instance without pose, and where they come from."""
    truth = store.instances
    sim, real = (stored_image(store, side, iid, at_source) for side in SIDES)
    notes = [("where", f"{truth.trajectory_names[truth.trajectory[iid]]} {truth.seq[iid]}")]
    if not math.isnan(time := float(truth.timestamp[iid])):
        notes.append(("time", f"{time:.3f} s"))
    query = "SELECT domain, rgb_path FROM frame WHERE iid = ? ORDER BY domain"
    notes += [
        (f"{printable(domain)} file", printable(path))
        for domain, path in store.execute(query, [iid])
        if path is not None
    ]
    return InstanceInput(
        iid=iid,
        sim=SideView(rgb=sim.rgb, title=sim.title),
        real=SideView(rgb=real.rgb, title=real.title),
        notes=(*notes, *sim.notes, *real.notes),
    )


def _named(names: tuple[str, ...], code: int) -> str:
    return names[code] if code >= 0 else "no room"


def _gap(columns: RunColumns, iid: int) -> str:
    missing = [side for side in SIDES if math.isnan(columns.side(side).error[iid])]
    if missing:
        return f"unknown: no {' and no '.join(missing)} prediction"
    gap, shift = columns.gap[iid], columns.shift[iid]
    return f"{gap:+.2f} m (real - sim error), shift {shift:.2f} m"


def _ranks(store: Store, run: str, iid: int, population: Population) -> str:
    """Ranks among the new instances; among all of them where these are included."""
    columns = store.run_columns(run)
    if population.leaves_out_trained(columns) and not columns.trained[iid]:
        places = [population_ranks(population, columns, side) for side in SIDES]
        sim, real = (int(column[iid]) or "none" for column in places)
        return f"sim {sim}, real {real} of {int(places[1].max())} new instances by error"
    totals = {side: int(np.isfinite(columns.side(side).error).sum()) for side in SIDES}
    ranks = {side: columns.side(side).rank[iid] or "none" for side in SIDES}
    trained = int(np.count_nonzero(columns.valid & columns.trained))
    known = f" by error, {trained} trained on included" if trained else " by error"
    if totals["sim"] == totals["real"]:
        return f"sim {ranks['sim']}, real {ranks['real']} of {totals['real']}{known}"
    return ", ".join(f"{side} {ranks[side]} of {totals[side]}" for side in SIDES) + known


def _neighbours(store: Store, run: str, iid: int, population: Population) -> list[tuple[str, str]]:
    """The most similar instances by embedding on each side; nothing without embeddings."""
    sides = []
    for side in SIDES:
        try:
            near, _ = nearest_neighbours.neighbours(store, run, side, iid, NEIGHBOURS, population)
        except NotComputedError:
            return []
        listed = " ".join(str(other) for other in near if other != iid)
        sides.append(f"{side} {listed or 'none'}")
    return [("alike", ", ".join(sides))]


def _side(
    store: Store,
    run: str,
    iid: int,
    side: Side,
    heat: NDArray[np.float32] | None,
    shown: ModelInput,
    **mark: Any,
) -> SideView:
    """One side with its prediction; `mark`: what `_object_mark` found."""
    part = store.run_columns(run).side(side)
    values = [part.x, part.y, part.heading, part.error, part.heading_error]
    x, y, heading, error, turn = (float(column[iid]) for column in values)
    return SideView(
        rgb=shown.rgb,
        depth=shown.depth,
        heat=heat,
        pose=None if math.isnan(x) else PoseNumbers(x, y, heading, error, turn),
        title=shown.title,
        original=shown.original,
        **mark,
    )


def place_in_image(region: NDArray[np.bool_]) -> str:
    """Where the centre of a region (h, w) lies, by thirds: `top left`, `right`, `middle`."""
    rows, columns = np.nonzero(region)
    height, width = region.shape
    row = _ROWS[min(2, int(3 * (rows.mean() + 0.5) / height))]
    column = _COLUMNS[min(2, int(3 * (columns.mean() + 0.5) / width))]
    return " ".join(filter(None, (row, column))) or "middle"


def _object_mark(store: Store, run: str, side: Side, iid: int, label: str) -> dict[str, Any]:
    """The pixels of a class of objects in an image, and the middle of them on the map.

    Both cameras of the domain are taken for the same, as far as the place is concerned.
    """
    name = store.displayed_run(run).domain(side)
    if not name or not store.has_frames(name) or not store.is_imaged(name, iid):
        return {}
    values = [value for value, each in store.label_names.items() if each == label]
    marked = np.isin(store.label_images(name, iid, iid + 1)[0], values)
    if not marked.any():
        return {}
    domain = store.domain(name)
    if not domain.has_depth:
        return {"marked": marked}
    depth = store.frames(name, iid, iid + 1, ("depth",))["depth"]
    known = (depth[0] >= domain.depth_raw_min) & (depth[0] <= domain.depth_raw_max) & marked
    if not known.any():
        return {"marked": marked}
    rows, columns = (np.arange(size, dtype=np.float64) + 0.5 for size in marked.shape)
    x, y, _ = camera.to_floor(
        camera.rays(domain.depth, rows, columns), depth * np.float64(domain.depth_scale), domain,
        store.poses(name)[iid : iid + 1], store.dataset.y_down,
    )  # fmt: skip
    place = float(np.median(x[0][known])), float(np.median(y[0][known]))
    return {"marked": marked, "place": place}


def _mark_note(label: str | None, marks: dict[Side, dict[str, Any]]) -> list[tuple[str, str]]:
    """Where a class of objects is marked; nothing without one."""
    if label is None:
        return []
    found = [side for side, mark in marks.items() if mark]
    return [("marked", f"{label} in {' and '.join(found) or 'neither image'} (escape: no mark)")]
