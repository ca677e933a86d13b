"""The numbers of the scatter view: sim error against real error, best and worst 15 %, density."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.metrics.top_k import top_k
from s2rstore.records import Bounds
from s2rtui.analysis.binning import (
    Bins,
    Bools,
    Counts,
    bin_values,
    count_selected,
    joint_bins,
    selection_indices,
)
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import Mark
from s2rtui.charts.scatter.axis import WHOLE, ErrorAxis, ErrorPlane, error_axis
from s2rtui.charts.shared.points import valid_cursor
from s2rtui.drawing.scale import Floats

PERCENT = 15
"""Share of the base population: the worst 15 % of a side are called poor, the best 15 % good."""
DENSITY_ABOVE = 10_000
"""Above this number of instances in view, cells are shaded by their counts."""
Rank = Literal["best", "worst"]
SIM_LARGER, EQUAL, REAL_LARGER = range(3)
"""Codes of the side of the diagonal: which error is larger."""


@dataclass(frozen=True, slots=True)
class Quadrant:
    """Instances that are extreme on both sides: `sim` and `real` say at which end."""

    sim: Rank
    real: Rank

    @property
    def name(self) -> str:
        words = {"best": "good", "worst": "poor"}
        if self.sim == self.real:
            return f"{words[self.sim]} in both"
        return f"{words[self.sim]} in sim, {words[self.real]} in real"

    @property
    def expression(self) -> str:
        return f"{self.sim}({PERCENT}%, sim.error) & {self.real}{PERCENT}"


QUADRANTS = (
    Quadrant("worst", "best"),
    Quadrant("best", "worst"),
    Quadrant("worst", "worst"),
    Quadrant("best", "best"),
)
"""The quadrants; in the first two the sides disagree."""


@dataclass(frozen=True, slots=True, eq=False)
class ScatterInput:
    """Errors (N,) of both sides in `unit`; selected, valid: (N,) bool; cursor: an iid.

    trained: (N,) marks instances that the model was trained on, None where none is shown. viewport:
    the part of the plane in view, in fractions of its axes; None for all of it.
    """

    sim: Floats
    real: Floats
    selected: Bools
    valid: Bools
    cursor: int | None = None
    mark: Mark | None = None
    unit: str = "m"
    trained: Bools | None = None
    viewport: Bounds | None = None

    @property
    def plane(self) -> ErrorPlane:
        """The plane with the part of it that is in view."""
        return ErrorPlane(self.axis, self.viewport or WHOLE)

    @property
    def axis(self) -> ErrorAxis:
        """The axis of both sides, from all instances: it does not depend on those in view."""
        return error_axis(self.sim, self.real)


@dataclass(frozen=True, slots=True)
class Limits:
    """Errors that separate the best and the worst 15 % of a side from the others; NaN for none.

    best: the largest error of the best, worst: the smallest error of the worst.
    """

    best: float
    worst: float


@dataclass(frozen=True, slots=True)
class ScatterSummary:
    """Counts of instances: `total` in view, `selected` of them.

    sim_larger, real_larger: selected instances by side of the diagonal. quadrants: per entry of
    `QUADRANTS` the instances in view and the selected ones. below: instances in view with an error
    below the axis. sim, real: limits of each side.
    """

    total: int
    selected: int
    sim_larger: int
    real_larger: int
    quadrants: tuple[tuple[int, int], ...]
    below: int
    sim: Limits
    real: Limits


@dataclass(frozen=True, slots=True, eq=False)
class ScatterModel:
    """The part of the plane in view in h x w cells, row 0 at the top.

    count: (h, w) selected instances per cell. larger: (h, w) SIM_LARGER, REAL_LARGER, or EQUAL for
    cells with both. grey: (4h, 2w) braille dots of instances in view, where no selected one is.
    trained: (h, w) cells with a selected trained instance, None where none is shown. peak: the
    largest count of all instances in view per cell. dense: whether cells are shaded.
    """

    plane: ErrorPlane
    count: Counts
    larger: NDArray[np.int8]
    grey: Bools
    trained: Bools | None
    peak: int
    dense: bool
    summary: ScatterSummary
    cursor: int | None


def scatter_model(data: ScatterInput, columns: int, rows: int) -> ScatterModel:
    """Count the instances in `columns` x `rows` cells."""
    plane, selection = data.plane, selection_indices(data.selected, data.valid)
    coloured = _sided_cells(data.sim, data.real, plane, columns, rows)
    selected, total = (
        part.reshape(rows, columns, 3) for part in count_selected(coloured, selection)
    )
    count = selected.sum(axis=2)
    dots = _dots(data.sim, data.real, plane, columns, rows)
    held = (count_selected(dots, selection)[1] > 0).reshape(rows, 4, columns, 2)
    grey = (held & (count == 0)[:, None, :, None]).reshape(4 * rows, 2 * columns)
    summary = scatter_summary(data)
    return ScatterModel(
        plane=plane,
        count=count,
        larger=_larger(selected),
        grey=grey,
        trained=_trained_cells(data, selection.members, columns, rows),
        peak=int(total.sum(axis=2).max()),
        dense=summary.total > DENSITY_ABOVE,
        summary=summary,
        cursor=_known_cursor(data),
    )


def scatter_summary(data: ScatterInput) -> ScatterSummary:
    """Count the instances by side of the diagonal and by quadrant."""
    selection = selection_indices(data.selected, data.valid)
    sides, _ = count_selected(_diagonal_sides(data.sim, data.real), selection)
    marks = _quadrant_marks(data.sim, data.real, data.valid)
    quadrants = [count_selected(mark, selection) for mark in marks]
    low = data.axis.low
    return ScatterSummary(
        total=int(np.count_nonzero(data.valid)),
        selected=int(sides.sum()),
        sim_larger=int(sides[SIM_LARGER]),
        real_larger=int(sides[REAL_LARGER]),
        quadrants=tuple((int(total[0]), int(selected[0])) for selected, total in quadrants),
        below=_number_below(data.sim, data.real, data.valid, low) if data.axis.log else 0,
        sim=_limits(data.sim, data.valid),
        real=_limits(data.real, data.valid),
    )


@cached_by_identity(16)
def extreme(errors: Floats, valid: Bools, rank: Rank) -> Bools:
    """The best or worst 15 % of the valid instances (N,), as the selection language counts them."""
    count = math.ceil(PERCENT * int(np.count_nonzero(valid)) / 100)
    return top_k(np.asarray(errors, dtype=np.float64), valid, count, rank == "worst")


@cached_by_identity(8)
def _limits(errors: Floats, valid: Bools) -> Limits:
    best, worst = (errors[extreme(errors, valid, rank)] for rank in ("best", "worst"))
    return Limits(
        float(best.max()) if best.size else math.nan,
        float(worst.min()) if worst.size else math.nan,
    )


@cached_by_identity(4)
def _quadrant_marks(sim: Floats, real: Floats, valid: Bools) -> tuple[Bins, ...]:
    """One bin for each of `QUADRANTS`: the instances that belong to it."""
    masks = (
        extreme(sim, valid, quadrant.sim) & extreme(real, valid, quadrant.real)
        for quadrant in QUADRANTS
    )
    return tuple(Bins(np.where(mask, 0, 1).astype(np.uint16), 1) for mask in masks)


@cached_by_identity(8)
def _number_below(sim: Floats, real: Floats, valid: Bools, low: float) -> int:
    return int(np.count_nonzero(((sim < low) | (real < low)) & valid))


@cached_by_identity(8)
def _diagonal_sides(sim: Floats, real: Floats) -> Bins:
    """The side of the diagonal of each instance with both errors, as bins."""
    return bin_values(np.sign(np.asarray(real, dtype=np.float64) - sim) + 1, 3)


@cached_by_identity(8)
def _sided_cells(sim: Floats, real: Floats, plane: ErrorPlane, columns: int, rows: int) -> Bins:
    """Cell and side of the diagonal together."""
    return joint_bins(_places(sim, real, plane, columns, rows), _diagonal_sides(sim, real))


def _trained_cells(
    data: ScatterInput, selected: NDArray[np.intp], columns: int, rows: int
) -> Bools | None:
    if data.trained is None:
        return None
    held = np.zeros(rows * columns * 3 + 1, dtype=np.bool_)
    codes = _sided_cells(data.sim, data.real, data.plane, columns, rows).codes
    held[codes[selected[data.trained[selected]]]] = True
    return np.asarray(held[:-1].reshape(rows, columns, 3).any(axis=2))


@cached_by_identity(8)
def _dots(sim: Floats, real: Floats, plane: ErrorPlane, columns: int, rows: int) -> Bins:
    return _places(sim, real, plane, 2 * columns, 4 * rows)


def _places(sim: Floats, real: Floats, plane: ErrorPlane, columns: int, rows: int) -> Bins:
    """The cell of each instance in view with both errors, row by row from the top."""
    across = bin_values(np.floor(plane.drawn_across(sim) * columns), columns)
    down = bin_values(rows - 1 - np.floor(plane.drawn_up(real) * rows), rows)
    return joint_bins(down, across)


def _larger(selected: Counts) -> NDArray[np.int8]:
    """The side whose error is larger in each cell, (h, w); from counts (h, w, 3) by that side."""
    sim = (selected[..., SIM_LARGER] > 0) & (selected[..., EQUAL:].sum(axis=2) == 0)
    real = (selected[..., REAL_LARGER] > 0) & (selected[..., :REAL_LARGER].sum(axis=2) == 0)
    return np.where(sim, SIM_LARGER, np.where(real, REAL_LARGER, EQUAL)).astype(np.int8)


def _known_cursor(data: ScatterInput) -> int | None:
    cursor = valid_cursor(data.cursor, data.valid)
    known = cursor is not None and np.isfinite([data.sim[cursor], data.real[cursor]]).all()
    return cursor if known else None
