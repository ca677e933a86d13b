"""The map: instances at their true positions, predictions and heat on the floor plan."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.files.planned_poses import PlannedPose
from s2rstore.reader import Store
from s2rstore.records import NO_RUN, SIDES, Bounds, Room, Side
from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import BrushShape
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.instance import SideView
from s2rtui.charts.shared.planes import (
    cursor_phrases,
    ground_marks,
    map_plot,
    place_of,
    shown_area,
    shown_rooms,
    true_columns,
    valid_cursor,
    value_range,
)
from s2rtui.charts.view import Pane, PointsView, Table
from s2rtui.drawing.drawing import ColourBar, Drawing
from s2rtui.drawing.floor import floor_heat_scale
from s2rtui.drawing.heat_colours import RampName
from s2rtui.drawing.plane_marks import Arcs, Columns, Floor, Place, Poses, Segments, Signs
from s2rtui.drawing.plot import Mark, Phrase
from s2rtui.drawing.scale import Floats
from s2rtui.session import map_values
from s2rtui.session.heatmaps import SIGNED, sample_note, trust_text, unit
from s2rtui.session.state import MapMode, State
from s2rtui.session.view_settings import ZoomPlane, map_plane

_TITLES = {
    "glyph": "direction and size of the errors",
    "full": "predicted and true positions",
}
_SUBTITLES = {
    "glyph": "direction and size of both errors",
    "full": "predictions in sim and real, joined to the truth",
}
_FRAME_COLUMNS, _FRAME_ROWS = 4, 3
"""Columns and rows of the axes and the legend."""
_POSE = ("x_m", "y_m", "heading_deg")


@dataclass(frozen=True, slots=True, eq=False)
class MapInput:
    """The map of one run.

    truth, sim, real: true and predicted positions x and y (N,), metres; sim_truth, real_truth: the
    true positions of the images of each side, from which its errors are measured. headings,
    sim_headings, real_headings: (N,) radians, None where there are none. values: (N,) of mode
    "colour", NaN for none; `value_label` (empty without values) names them. live: predictions for
    the cursor that no column has. trained: (N,) instances that the model was trained on, None where
    none is shown. planned: poses at which new images shall be taken. unpaired: (N,) selected
    instances that lack an image of a side, None without any; `unpaired_text` says how many.
    objects: where the images of the cursor show the marked class of objects, `object_name`.
    """

    truth: Columns
    sim: Columns
    real: Columns
    sim_truth: Columns
    real_truth: Columns
    values: Floats
    selected: Bools
    valid: Bools
    floor: Floor
    rooms: tuple[Room, ...] = ()
    headings: Floats | None = None
    sim_headings: Floats | None = None
    real_headings: Floats | None = None
    cursor: int | None = None
    y_down: bool = True
    mode: MapMode = "colour"
    value_label: str = "shift"
    value_unit: str = "m"
    heat_label: str = "heat"
    heat_unit: str = ""
    live: tuple[tuple[Side, Place], ...] = ()
    trained: Bools | None = None
    planned: tuple[PlannedPose, ...] = ()
    unpaired: Bools | None = None
    unpaired_text: str = ""
    objects: tuple[Place, ...] = ()
    object_name: str = ""


def map_drawing(
    data: MapInput, viewport: Bounds | None = None, brush: BrushShape | None = None
) -> Drawing:
    """The layers of a map and its legend; `viewport`: the part of the plane in view, metres."""
    area = shown_area(viewport, data.floor.bounds, data.truth, data.valid)
    marks = [
        *ground_marks(data.floor, data.rooms, data.truth, data.selected, data.valid),
        *_MARKS[data.mode](data), *_pose_marks(data),
    ]  # fmt: skip
    legend: list[Phrase | ColourBar] = []
    if data.mode == "colour" and data.value_label:
        scale = value_range(data.values, data.valid)
        legend.append(ColourBar(data.value_label, data.value_unit, scale, clipped=True))
    if data.mode == "full":
        legend += [Phrase(role, role, role) for role in ("sim", "real", "truth")]
    heat = data.floor.heat
    if heat is not None and (ends := floor_heat_scale(heat, data.floor.heat_is_signed)) is not None:
        ramp: RampName = "signed heat" if data.floor.heat_is_signed else "heat"
        legend.append(ColourBar(data.heat_label, data.heat_unit, ends, ramp=ramp))
    if data.unpaired is not None:
        legend.append(Phrase(data.unpaired_text, "truth", "truth"))
    if data.objects:
        legend.append(Phrase(data.object_name, "truth", "pointer"))
    if data.planned:
        legend.append(Phrase(f"{len(data.planned)} planned poses", "planned", "planned"))
    legend += cursor_phrases(valid_cursor(data.cursor, data.valid))
    return Drawing((map_plot(marks, area, data.y_down),), notes=(tuple(legend),), brush=brush)


def _value_marks(data: MapInput) -> Iterator[Mark]:
    yield Signs(*data.truth, data.selected, data.valid, values=data.values,
                scale=value_range(data.values, data.valid), trained=data.trained)  # fmt: skip


def _arc_marks(data: MapInput) -> Iterator[Mark]:
    sim, real = errors(data.sim_truth, data.sim), errors(data.real_truth, data.real)
    yield Arcs(*data.truth, data.selected, data.valid, sim, real,
               full_scale(sim, real, data.valid), data.trained)  # fmt: skip


def _prediction_marks(data: MapInput) -> Iterator[Mark]:
    cursor = valid_cursor(data.cursor, data.valid)
    chosen = data.selected, data.valid
    yield Segments(data.sim_truth, data.sim, *chosen, "sim", cursor)
    yield Segments(data.real_truth, data.real, *chosen, "real", cursor)
    yield Signs(*data.sim, *chosen, "sim", "sim")
    yield Signs(*data.real, *chosen, "real", "real")
    yield Signs(*data.truth, *chosen, "truth", "truth", trained=data.trained)


_MARKS = {"colour": _value_marks, "glyph": _arc_marks, "full": _prediction_marks}
"""How the selected are drawn, per map mode."""


def _pose_marks(data: MapInput) -> Iterator[Mark]:
    """Instances of one side, planned poses, live predictions, those of the cursor's instance, and
    its true pose.
    """
    shown = data.valid
    if data.unpaired is not None:
        yield Signs(*data.truth, data.unpaired, data.unpaired, "truth", "truth")
        shown = data.valid | data.unpaired
    if data.planned:
        poses = ((pose.x_m, pose.y_m, math.radians(pose.heading_deg)) for pose in data.planned)
        yield Poses(tuple(poses), "planned")
    for side, place in data.live:
        yield Poses((place,), side, side)
    yield Poses(data.objects, "truth", "pointer")
    cursor = valid_cursor(data.cursor, shown)
    if data.mode == "full":
        yield Poses(place_of(data.sim, data.sim_headings, cursor), "sim", "sim")
        yield Poses(place_of(data.real, data.real_headings, cursor), "real", "real")
    yield Poses(place_of(data.truth, data.headings, cursor), "cursor", "cursor")


@cached_by_identity(8)
def errors(start: Columns, end: Columns) -> Columns:
    """Errors (N,) along x and y from true to predicted positions, metres."""
    return end[0] - start[0], end[1] - start[1]


@cached_by_identity(8)
def full_scale(sim: Columns, real: Columns, valid: Bools) -> float:
    """The error of an arc of full scale: the 99th percentile of the valid errors (N,)."""
    known = np.concatenate([np.hypot(*side)[valid] for side in (sim, real)])
    known = known[np.isfinite(known)]
    largest = float(np.percentile(known, 99)) if known.size else 0.0
    return largest if largest > 0 else 1.0


class MapView(PointsView):
    name = "map"
    needs_run = False
    key = "2"
    pane: Pane = "centre"
    description = "map: truth, predictions and heat on the floor plan"
    aliases = ("geomap",)
    loads = ("floor plan", "heat on the map", "seen floor")
    figure_size = (1600, 1200)

    def subtitle(self, scene: Scene) -> str:
        state = scene.state
        value = map_values.shown(scene.store, state.run, state.map_value)
        by_mode = {"colour": f"truth, coloured by {value.short or value.phrase}"} | _SUBTITLES
        text = by_mode[state.map_mode]
        if scene.store.missing_run:
            text = "true positions"
        if state.dims_unseen_floor:
            seen = f"what the selection saw{sample_note(state)}"
            failed = scene.loaded.failed.get("seen floor")
            if scene.loaded.seen_on_map(state) is not None:
                text += f", {seen}"
            else:
                text += f", {seen} is unknown: {failed}" if failed else f", loading {seen}"
        failed_loads = scene.loaded.failed
        missing = (name for name in ("floor plan", "heat on the map") if name in failed_loads)
        return text + "".join(f", no {name}: {failed_loads[name]}" for name in missing)

    def input(self, scene: Scene) -> MapInput:
        store, state, loaded = scene.store, scene.state, scene.loaded
        columns, run = store.run_columns(state.run), store.displayed_run(state.run)
        value = map_values.shown(store, state.run, state.map_value).name
        heat = None if state.shown_heat is None else loaded.heat_on_map(state)
        label, of_heat, is_signed = "heat", "", False
        if heat is not None:
            label, of_heat, is_signed = heat_facts(store, state, loaded.heat_note(state))
        return MapInput(
            true_columns(store), (columns.sim.x, columns.sim.y), (columns.real.x, columns.real.y),
            true_columns(store, run.sim_domain), true_columns(store, run.real_domain),
            map_values.column(store, state.run, value), state.selected, state.base,
            Floor(
                store.dataset.bounds, loaded.floor_plan, heat,
                heat_is_signed=is_signed, seen=loaded.seen_on_map(state),
            ),
            shown_rooms(scene), store.instances.heading, columns.sim.heading, columns.real.heading,
            state.cursor, store.dataset.y_down, state.map_mode,
            value if state.run != NO_RUN else "", heat_label=label, heat_unit=of_heat,
            live=_live_poses(scene), trained=state.marked, planned=state.planned,
            unpaired=state.unpaired, unpaired_text=state.unpaired_text,
            objects=_objects(scene), object_name=state.chosen_row("objects") or "",
        )  # fmt: skip

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        return map_drawing(self.input(scene), scene.state.viewport, scene.mark(self.name))

    def heading(self, scene: Scene) -> tuple[str, str]:
        state, data = scene.state, self.input(scene)
        phrase = map_values.shown(scene.store, state.run, state.map_value).phrase
        shown = _TITLES.get(state.map_mode, phrase) if state.run else "true positions"
        title, caption = f"{scene.title}: {shown}", scene.caption
        if data.floor.heat is not None:
            title += f"; heat: {data.heat_label}"
            if trust := trust_text(scene.store, state):
                caption += f"  ·  heat: {trust}"
        return title, caption

    def numbers(self, scene: Scene) -> Table:
        truth, run = scene.store.instances, scene.store.run_columns(scene.state.run)
        columns: tuple[NDArray[Any], ...] = (
            truth.x,
            truth.y,
            np.degrees(truth.heading),
            run.sim.x,
            run.sim.y,
            np.degrees(run.sim.heading),
            run.real.x,
            run.real.y,
            np.degrees(run.real.heading),
            run.shift,
        )
        names: tuple[str, ...] = (
            "iid",
            *_POSE,
            *(f"sim_{name}" for name in _POSE),
            *(f"real_{name}" for name in _POSE),
            "shift_m",
        )
        record = scene.store.displayed_run(scene.state.run)
        for side in SIDES:
            if (domain := record.domain(side)) in scene.store.domains_with_own_poses:
                x, y, heading = scene.store.poses(domain).T
                columns += (x, y, np.degrees(heading))
                names += tuple(f"{side}_true_{name}" for name in _POSE)
        selection = np.flatnonzero(scene.state.selected)
        picked = [column[selection].tolist() for column in columns]
        if scene.state.marked is not None:
            names, picked = (*names, "split"), [*picked, scene.splits(selection)]
        return names, list(zip(selection.tolist(), *picked, strict=True))

    def summary(self, scene: Scene) -> str:
        state, truth = scene.state, scene.store.instances
        shift = scene.store.run_columns(state.run).shift[state.selected]
        shift = shift[np.isfinite(shift)]
        codes = truth.room[state.selected]
        counts = [(int((codes == code).sum()), name) for code, name in enumerate(truth.room_names)]
        rooms = ", ".join(f"{name} {n}" for n, name in sorted(counts, key=lambda r: -r[0]) if n)
        of_run = f"Map of run {state.run}" if state.run else "Map of the true positions"
        text = f"{of_run}: {state.count_text} instances; {rooms or 'in no room'}."
        if shift.size:
            text += (
                f" Sim and real predictions lie {np.median(shift):.2f} m apart in the median, "
                f"{shift.max():.2f} m at most."
            )
        return text

    def height(self, scene: Scene, width: int) -> int:
        """The rows in which the whole map fills the width."""
        bounds = scene.store.dataset.bounds
        if not (bounds.width > 0 and bounds.height > 0):
            return 0
        chart = max(1, width - _FRAME_COLUMNS)
        return math.ceil(chart * bounds.height / bounds.width / 2) + _FRAME_ROWS

    def zoom_plane(self, scene: Scene) -> ZoomPlane:
        return map_plane(scene.store, scene.state)


VIEW = MapView()


def _objects(scene: Scene) -> tuple[Place, ...]:
    """Where the instance's images show the marked class of objects."""
    shown = scene.loaded.pictures
    if shown is None or shown.iid != scene.state.cursor or not scene.state.chosen_row("objects"):
        return ()
    places = (side.place for _, side in reversed(shown.sides))
    return tuple((*place, None) for place in places if place is not None)


def _live_poses(scene: Scene) -> tuple[tuple[Side, Place], ...]:
    """The predicted poses of an instance that is being adjusted."""
    state = scene.state
    adjusted = scene.loaded.adjusted(state) if state.adjusting else None
    if adjusted is None or adjusted.iid != state.cursor:
        return ()
    pairs: tuple[tuple[Side, SideView], ...] = (("sim", adjusted.sim), ("real", adjusted.real))
    poses = ((side, shown.pose) for side, shown in pairs if shown.pose is not None)
    return tuple((side, (pose.x, pose.y, pose.heading)) for side, pose in poses)


def heat_facts(store: Store, state: State, note: str = "") -> tuple[str, str, bool]:
    """The label of the heat that is shown, its unit, and whether its colours diverge from 0.

    The label has kind and side, the aggregate if it is not the mean, and the note. The stored heat
    of a run is that of all instances and trajectories, also of those that it was trained on.
    """
    choice = state.shown_heat
    if choice is None:
        return "heat", "", False
    is_of_many = state.overlay in ("selection", "run")
    trained = 0
    if state.overlay == "run":
        columns = store.run_columns(state.run)
        trained = int(np.count_nonzero(columns.trained & columns.valid))
    whole = f"all instances, {trained} trained on" if trained else ""
    aggregate = state.aggregate if is_of_many and state.aggregate != "mean" else ""
    label = ", ".join(part for part in (choice.label, choice.side, aggregate, whole, note) if part)
    if aggregate == "count":
        return label, "pixels", False
    return label, unit(store, state.run, choice), choice.kind in SIGNED
