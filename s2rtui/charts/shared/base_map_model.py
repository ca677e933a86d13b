"""The inputs and numbers of maps: positions, values, scales, selections."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.files.planned_poses import PlannedPose
from s2rstore.reader import Store
from s2rstore.records import NO_RUN, Bounds, Room, Side
from s2rtui.analysis.binning import Bools, SelectionIndices, count_selected, selection_indices
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.canvas import BrushShape, Pixels
from s2rtui.charts.shared.base_map_background import MapBackground, heat_scale
from s2rtui.charts.shared.point_bins import (
    own_positions,
    point_cells,
    stacked_points,
    true_positions,
    valid_cursor,
)
from s2rtui.drawing.scale import Floats, Interval, percentile_range, scale_fraction
from s2rtui.session import map_values
from s2rtui.session.heatmaps import SIGNED, unit
from s2rtui.session.state import HeatChoice, MapMode, State


@dataclass(frozen=True, slots=True)
class LivePose:
    """A predicted pose that is not in the store: metres, radians."""

    side: Side
    x: float
    y: float
    heading: float


@dataclass(frozen=True, slots=True, eq=False)
class MapInput:
    """The map of one run.

    truth, sim, real: (N, 2) metres. values: (N,) of mode "colour", NaN for none;
    `value_label` (empty without values) and `value_unit` name it, `value_range` fixes its scale
    (default: the 1st .. 99th percentile of the valid). selected, valid: (N,) bool; cursor: an
    iid. headings, (N,) radians: the truth's. floor_plan, heat, clip: see `MapBackground`. Columns
    must never change in place: results computed from them are cached for the same arrays. `live`
    are predictions for the cursor that no column has. `sim_truth`, `real_truth`: (N, 2) true
    positions of the side's images where they differ from `truth`, those of the instances.
    `trained` (N,) marks instances that the model was trained on; None where none is shown.
    `planned` are the poses at which new images shall be taken.
    """

    truth: Floats
    sim: Floats
    real: Floats
    values: Floats
    selected: Bools
    valid: Bools
    bounds: Bounds
    headings: Floats | None = None
    sim_headings: Floats | None = None
    real_headings: Floats | None = None
    cursor: int | None = None
    y_down: bool = True
    mode: MapMode = "colour"
    value_label: str = "shift"
    value_unit: str = "m"
    value_range: Interval | None = None
    floor_plan: NDArray[np.uint8] | None = None
    heat: Floats | None = None
    heat_label: str = "heat"
    heat_unit: str = ""
    heat_range: Interval | None = None
    heat_is_signed: bool = False
    clip: Floats | Bools | None = None
    rooms: tuple[Room, ...] = ()
    room_names: bool = True
    mark: BrushShape | None = None
    live: tuple[LivePose, ...] = ()
    sim_truth: Floats | None = None
    real_truth: Floats | None = None
    trained: Bools | None = None
    planned: tuple[PlannedPose, ...] = ()

    def true_positions(self, side: Side) -> Floats:
        """(N, 2) positions of the side's images, from which its errors are measured."""
        own = self.sim_truth if side == "sim" else self.real_truth
        return self.truth if own is None else own

    @property
    def ground(self) -> MapBackground:
        rooms = self.rooms if self.room_names else ()
        return MapBackground(
            self.bounds, self.y_down, self.floor_plan, self.heat, self.heat_range,
            self.heat_is_signed, self.clip, rooms,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class MapModel:
    """The numbers that a map draws, and its scales.

    highlighted: number of selected valid instances; others: of unselected valid ones; cursor: a
    valid iid or None.
    """

    selection: SelectionIndices
    highlighted: int
    others: int
    cursor: int | None
    value_range: Interval
    heat_range: Interval | None


def map_model(data: MapInput) -> MapModel:
    """Select what is drawn and find the scales."""
    valid: Bools = np.asarray(data.valid, dtype=np.bool_)
    selection = selection_indices(np.asarray(data.selected, dtype=np.bool_), valid)
    highlighted, others = selection_sizes(selection)
    scale = data.value_range or value_range(data.values, valid)
    cursor = valid_cursor(data.cursor, valid)
    return MapModel(selection, highlighted, others, cursor, scale, heat_scale(data.ground))


def selection_sizes(selection: SelectionIndices) -> tuple[int, int]:
    """Numbers of selected and of unselected instances of the base population."""
    few, base = len(selection.indices), int(np.count_nonzero(selection.base))
    return (base - few, few) if selection.inverted else (few, base - few)


@cached_by_identity(16)
def value_range(values: Floats, valid: Bools) -> Interval:
    """The scale of values (N,): 1st to 99th percentile of the valid ones."""
    return percentile_range(values[valid])


def sorted_by_value(data: MapInput, model: MapModel) -> tuple[NDArray[np.intp], Floats]:
    """Selected iids by increasing value (the largest is drawn on top), with scale fractions."""
    ids = model.selection.members
    shares = scale_fraction(np.asarray(data.values)[ids], model.value_range)
    ordered = np.argsort(np.nan_to_num(shares, nan=-1.0), kind="stable")
    return ids[ordered], shares[ordered]


def selected_in_frame(
    truth: Floats, selection: SelectionIndices, frame: MapFrame, limit: int
) -> NDArray[np.intp] | None:
    """The selected iids inside the frame; None if there are more than `limit`."""
    places = point_cells(truth, frame)
    if int(count_selected(places, selection)[0].sum()) > limit:
        return None
    ids = selection.members
    return ids[places.codes[ids] < places.count]


def default_view(bounds: Bounds, truth: Floats, valid: Bools) -> Bounds:
    """The bounds, or the bounding box of the points where the bounds are empty."""
    if bounds.width > 0 and bounds.height > 0:
        return bounds
    points = np.asarray(truth, dtype=np.float64)[np.asarray(valid, dtype=np.bool_)]
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return Bounds(0.0, 0.0, 1.0, 1.0)
    (x0, y0), (x1, y1) = points.min(axis=0) - 0.5, points.max(axis=0) + 0.5
    return Bounds(float(x0), float(y0), float(x1), float(y1))


def map_input(
    store: Store,
    state: State,
    floor_plan: Pixels | None = None,
    heat: Floats | None = None,
    seen: Floats | None = None,
    mark: BrushShape | None = None,
    heat_note: str = "",
) -> MapInput:
    """The map of the state's run; `heat_note` names the source of outdated heat."""
    truth, columns = store.instances, store.run_columns(state.run)
    run = store.displayed_run(state.run)
    value = map_values.shown(store, state.run, state.map_value).name
    choice = state.shown_heat
    has_heat = heat is not None and choice is not None
    return MapInput(
        truth=true_positions(store),
        sim=stacked_points(columns.sim.x, columns.sim.y),
        real=stacked_points(columns.real.x, columns.real.y),
        values=map_values.column(columns, value),
        selected=state.selected,
        valid=state.base,
        bounds=store.dataset.bounds,
        headings=truth.heading,
        sim_headings=columns.sim.heading,
        real_headings=columns.real.heading,
        cursor=state.cursor,
        y_down=store.dataset.y_down,
        mode=state.map_mode,
        value_label=value if state.run != NO_RUN else "",
        floor_plan=floor_plan,
        heat=heat if has_heat else None,
        heat_label=_heat_label(store, state, choice, heat_note) if has_heat and choice else "heat",
        heat_unit=_heat_unit(store, state, choice) if has_heat and choice else "",
        heat_is_signed=has_heat and choice is not None and _is_signed(state, choice),
        clip=seen,
        rooms=store.rooms,
        room_names=state.room_names,
        mark=mark,
        sim_truth=own_positions(store, run.sim_domain),
        real_truth=own_positions(store, run.real_domain),
        trained=state.marked,
        planned=state.planned,
    )


def _heat_label(store: Store, state: State, choice: HeatChoice, note: str) -> str:
    """Kind and side of the heat, the aggregate if it is not the mean, and the note.

    The stored heat of a run is that of all instances and trajectories, also of those instances that
    it was trained on.
    """
    aggregated = state.overlay in ("selection", "run") and state.aggregate != "mean"
    trained = 0
    if state.overlay == "run":
        columns = store.run_columns(state.run)
        trained = int(np.count_nonzero(columns.trained & columns.valid))
    whole = f"all instances, {trained} trained on" if trained else ""
    parts = [choice.label, choice.side, state.aggregate if aggregated else "", whole, note]
    return ", ".join(part for part in parts if part)


def _heat_unit(store: Store, state: State, choice: HeatChoice) -> str:
    return "pixels" if _counts(state) else unit(store, state.run, choice)


def _is_signed(state: State, choice: HeatChoice) -> bool:
    return choice.kind in SIGNED and not _counts(state)


def _counts(state: State) -> bool:
    return state.overlay in ("selection", "run") and state.aggregate == "count"
