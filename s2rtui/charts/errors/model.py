"""The numbers of the errors view: histograms and medians of both sides in common bins."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis import joint_histogram
from s2rtui.analysis.binning import Bins, Bools, bin_values, median_selected, selection_indices
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import Mark
from s2rtui.charts.shared.points import valid_cursor
from s2rtui.drawing.scale import Floats

NAMES = ("sim", "real")
FINE = 250
"""About this number of bins is counted and merged for the bars; fine bins give fast medians."""
Counts = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class ErrorsInput:
    """Errors (N,) of both sides in `unit`; `selected` and `valid`: (N,) bool; cursor: an iid.

    `upper` is the right end of the axis (default: the 99th percentile of both sides).
    """

    sim: Floats
    real: Floats
    selected: Bools
    valid: Bools
    label: str = "error"
    unit: str = "m"
    upper: float | None = None
    cursor: int | None = None
    mark: Mark | None = None


@dataclass(frozen=True, slots=True, eq=False)
class SideErrors:
    """One side: counts (bins,) of selected and of all valid instances, median of the selected.

    beyond: number of valid errors above the last edge. cursor: the error of the cursor's instance.
    """

    highlighted: Counts
    total: Counts
    median: float
    beyond: int
    cursor: float | None

    @property
    def peak(self) -> int:
        """The largest count of this side."""
        return int(max(self.total.max(), 1))


@dataclass(frozen=True, slots=True, eq=False)
class ErrorsModel:
    """Both histograms. edges: (bins + 1,), from 0; larger errors count in the last bin."""

    edges: NDArray[np.float64]
    sim: SideErrors
    real: SideErrors

    @property
    def upper(self) -> float:
        return float(self.edges[-1])

    @property
    def peak(self) -> int:
        """The count of a bar of full height, on both sides."""
        return max(self.sim.peak, self.real.peak)


def errors_model(data: ErrorsInput, number: int) -> ErrorsModel:
    """Count both sides from 0 to `upper`, by default the 99th percentile of both."""
    upper = data.upper
    if upper is None:
        upper = _upper(data.sim, data.real, data.valid)
    upper = upper if upper > 0 else 1.0
    count = max(1, number)
    parts = _counts((data.sim, data.real), upper, count, data.selected, data.valid)
    sim, real = (
        SideErrors(
            highlighted, total, middle, _beyond(side, upper, data.valid), _cursor(side, data)
        )
        for side, (highlighted, total, middle) in zip((data.sim, data.real), parts, strict=True)
    )
    return ErrorsModel(np.linspace(0.0, upper, count + 1), sim, real)


@cached_by_identity(4)
def _counts(
    sides: tuple[Floats, ...], upper: float, count: int, selected: Bools, valid: Bools
) -> list[tuple[Counts, Counts, float]]:
    """Per side: counts of the selected and of all, and the median of the selected."""
    columns = [_bins(side, upper, count * max(1, FINE // count)) for side in sides]
    counted = joint_histogram.joint_counts(columns, selection_indices(selected, valid))
    return [
        (
            highlighted.reshape(count, -1).sum(axis=1),
            total.reshape(count, -1).sum(axis=1),
            median_selected(side, column, highlighted, selected, valid),
        )
        for side, column, (highlighted, total) in zip(sides, columns, counted, strict=True)
    ]


def _cursor(errors: Floats, data: ErrorsInput) -> float | None:
    cursor = valid_cursor(data.cursor, data.valid)
    if cursor is None:
        return None
    error = float(errors[cursor])
    return error if math.isfinite(error) else None


@cached_by_identity(16)
def _upper(sim: Floats, real: Floats, valid: Bools) -> float:
    """The 99th percentile of the known valid errors; 1 without any."""
    both = np.concatenate([np.asarray(side)[np.asarray(valid)] for side in (sim, real)])
    both = both[np.isfinite(both)]
    return float(np.percentile(both, 99)) if both.size else 1.0


@cached_by_identity(32)
def _bins(errors: Floats, upper: float, count: int) -> Bins:
    column = np.asarray(errors, dtype=np.float64)
    places = np.clip(column / upper * count, 0, np.nextafter(count, 0))
    return bin_values(np.where(np.isfinite(column), places, np.nan), count)


@cached_by_identity(16)
def _beyond(errors: Floats, upper: float, valid: Bools) -> int:
    past = np.isfinite(errors) & (errors > upper) & valid
    return int(np.count_nonzero(past))
