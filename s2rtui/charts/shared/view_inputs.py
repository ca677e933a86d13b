"""From a state to the numbers that each view shows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.image_header import floor_plan_bytes
from s2rstore.metrics import run_metrics, similarity
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rtui.analysis.identity_cache import ArrayKey, cached_by_identity
from s2rtui.canvas.brush_surface import Mark
from s2rtui.charts.shared.inputs import (
    GeoMapInput,
    InstanceInput,
    OverviewRow,
    PoseNumbers,
    SideView,
    UmapInput,
)
from s2rtui.session.heatmaps import SIGNED, ray_of, run_range, unit
from s2rtui.session.model_input import ModelInput, model_input
from s2rtui.session.state import HeatChoice, State

Pixels = NDArray[np.uint8]
Grid = NDArray[np.float32]
NEIGHBOURS = 5
"""How many instances are told, and selected, as those that a model sees alike."""


def overview_rows(
    store: Store, runs: Sequence[str] | None = None
) -> tuple[list[OverviewRow], float]:
    """A row per computed run (or per named one), and the baseline of the first one's instances.

    Figures leave out what the model was trained on.
    """
    rows = []
    for name in runs or [name for name, run in store.runs.items() if run.key]:
        sim, real = (run_metrics.headline(store, name, side) for side in ("sim", "real"))
        rows.append(
            OverviewRow(
                run=name,
                sim_accuracy=sim.accuracy.value,
                real_accuracy=real.accuracy.value,
                sim_interval=(sim.accuracy.low, sim.accuracy.high),
                real_interval=(real.accuracy.low, real.accuracy.high),
                n=real.n,
                note="" if real.n else "the model was trained on every instance",
            )
        )
    return rows, run_metrics.baseline(store, rows[0].run) if rows else math.nan


def truth_points(store: Store) -> NDArray[np.float64]:
    """(N, 2) true positions, metres."""
    return _points(store.instances.x, store.instances.y)


def map_input(
    store: Store,
    state: State,
    floor_plan: Pixels | None = None,
    heat: Grid | None = None,
    seen: Grid | None = None,
    mark: Mark | None = None,
    heat_note: str = "",
) -> GeoMapInput:
    """The map of the state's run; `heat_note` says of whom the heat is."""
    truth, columns = store.instances, store.run_columns(state.run)
    choice = state.heat
    shown = heat is not None and choice is not None
    return GeoMapInput(
        truth=truth_points(store),
        sim=_points(columns.sim.x, columns.sim.y),
        real=_points(columns.real.x, columns.real.y),
        values=columns.shift,
        selected=state.selected,
        valid=state.base,
        bounds=store.dataset.bounds,
        headings=truth.heading,
        sim_headings=columns.sim.heading,
        real_headings=columns.real.heading,
        cursor=state.cursor,
        y_down=store.dataset.y_down,
        mode=state.map_mode,
        floor_plan=floor_plan,
        heat=heat if shown else None,
        heat_label=_heat_label(state, choice, heat_note) if shown and choice else "heat",
        heat_unit=_heat_unit(store, state, choice) if shown and choice else "",
        clip=seen,
        rooms=store.rooms,
        room_names=state.room_names,
        mark=mark,
    )


def _heat_label(state: State, choice: HeatChoice, note: str) -> str:
    """The heat's name, its side and, where that is no mean, how it was gathered."""
    gathered = state.overlay in ("selection", "run") and state.aggregate != "mean"
    parts = [choice.label, choice.side, state.aggregate if gathered else "", note]
    return ", ".join(part for part in parts if part)


def _heat_unit(store: Store, state: State, choice: HeatChoice) -> str:
    counts = state.overlay in ("selection", "run") and state.aggregate == "count"
    return "pixels" if counts else unit(store, state.run, choice)


def _points(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 2); the same array for the same columns, so that plots can keep what they made of it."""
    return _stacked(ArrayKey(x), ArrayKey(y))


@cached_by_identity(24)
def _stacked(x: ArrayKey, y: ArrayKey) -> NDArray[np.float64]:
    return np.stack([np.asarray(x.array), np.asarray(y.array)], axis=1)


def instance_input(store: Store, run: str, iid: int, heat: HeatChoice | None) -> InstanceInput:
    """Pictures, heat and numbers of one instance; reads frames and heatmaps."""
    truth = store.instances
    on_depth = heat is not None and ray_of(heat) == "depth"
    both = heat is not None and heat.mode == "rgbd"
    room = truth.room[iid]
    trajectory = truth.trajectory_names[truth.trajectory[iid]]
    columns = store.run_columns(run)
    sim, real = (model_input(store, store.run(run), side, iid) for side in SIDES)
    return InstanceInput(
        iid=iid,
        sim=_side(store, run, iid, "sim", heat, sim),
        real=_side(store, run, iid, "real", heat, real),
        truth=(float(truth.x[iid]), float(truth.y[iid]), float(truth.heading[iid])),
        kind=heat.kind.replace("_", " ") if heat else None,
        mode=heat.mode if heat else None,
        unit=unit(store, run, heat) if heat else "",
        signed=bool(heat and heat.kind in SIGNED),
        heat_range=run_range(store, run, heat) if heat else None,
        over="both" if both else "depth" if on_depth else "rgb",
        notes=(
            ("where", f"{trajectory} {truth.seq[iid]}, {_named(truth.room_names, int(room))}"),
            ("gap", f"{columns.gap[iid]:+.2f} m, shift {columns.shift[iid]:.2f} m"),
            ("ranks", _ranks(store, run, iid)),
            *_neighbours(store, run, iid),
            *sim.notes,
            *real.notes,
        ),
    )


def _named(names: tuple[str, ...], code: int) -> str:
    return names[code] if code >= 0 else "no room"


def _ranks(store: Store, run: str, iid: int) -> str:
    columns = store.run_columns(run)
    total = int(columns.valid.sum())
    parts = []
    for side in ("sim", "real"):
        part = columns.sim if side == "sim" else columns.real
        parts.append(f"{side} {part.rank[iid]}" if part.rank[iid] else f"{side} none")
    return f"{', '.join(parts)} of {total} by error"


def _neighbours(store: Store, run: str, iid: int) -> list[tuple[str, str]]:
    """The instances that the run sees alike, on each side; nothing where embeddings lack."""
    found = []
    for side in SIDES:
        try:
            near, _ = similarity.neighbours(store, run, side, iid, NEIGHBOURS)
        except RequestError:
            return []
        listed = " ".join(str(other) for other in near if other != iid)
        found.append(f"{side} {listed or 'none'}")
    return [("alike", ", ".join(found))]


def _side(
    store: Store, run: str, iid: int, side: Side, heat: HeatChoice | None, shown: ModelInput
) -> SideView:
    part = store.run_columns(run).side(side)
    values = [part.x, part.y, part.heading, part.error, part.heading_error]
    x, y, heading, error, turn = (float(column[iid]) for column in values)
    return SideView(
        rgb=shown.rgb,
        depth=shown.depth,
        heat=None if heat is None else store.heatmap(run, heat.kind, side, iid, heat.mode),
        pose=None if math.isnan(x) else PoseNumbers(x, y, heading, error, turn),
        title=shown.title,
    )


@lru_cache(maxsize=4)
def floor_plan(path: str) -> Pixels:
    """The floor plan's picture, (H, W, 3); RequestError where it cannot be decoded."""
    from PIL import Image

    content = floor_plan_bytes(Path(path))
    try:
        with Image.open(BytesIO(content), formats=["PNG"]) as picture:
            return np.asarray(picture.convert("RGB"))
    except (OSError, ValueError, SyntaxError) as error:  # Pillow: damage is any of these
        raise RequestError(f"{path}: the floor plan is damaged ({error})") from error


def umap_input(store: Store, state: State, mark: Mark | None = None) -> UmapInput:
    """The embeddings of the state's run in the plane."""
    columns = store.run_columns(state.run)
    return UmapInput(
        _points(columns.sim.u, columns.sim.v),
        _points(columns.real.u, columns.real.v),
        None,
        state.selected,
        state.base,
        cursor=state.cursor,
        mark=mark,
    )


def point_of(points: NDArray[np.floating[Any]], iid: int | None) -> tuple[float, float] | None:
    """One of the points (N, 2), where it is known."""
    if iid is None or not np.isfinite(points[iid]).all():
        return None
    return float(points[iid, 0]), float(points[iid, 1])


def nearest(
    points: NDArray[np.floating[Any]], base: NDArray[np.bool_], at: tuple[float, float]
) -> int | None:
    """The iid of the base whose point (N, 2) is nearest."""
    with np.errstate(invalid="ignore"):
        distance = np.square(points[:, 0] - at[0]) + np.square(points[:, 1] - at[1])
    distance = np.where(base & np.isfinite(distance), distance, np.inf)
    iid = int(np.argmin(distance)) if distance.size else 0
    return iid if distance.size and np.isfinite(distance[iid]) else None
