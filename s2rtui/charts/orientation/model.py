"""The numbers of the orientation view: headings in bins of 5 degrees, circular means."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis import joint_histogram
from s2rtui.analysis.binning import Bins, Bools, SelectionIndices, bin_values, selection_indices
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import BrushShape
from s2rtui.canvas.marks import wrap_degrees
from s2rtui.charts.shared.point_bins import valid_cursor
from s2rtui.drawing.scale import Floats

BINS = 72
WIDTH = 360 / BINS
NAMES = ("sim", "truth", "real")
EXACTLY_UP_TO = 20_000
"""Up to this number, mean directions are exact; above it they are computed from bins."""
Counts = NDArray[np.intp]
Lengths = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class OrientationInput:
    """Headings predicted in sim, true, predicted in real, (N,) radians each, NaN for none.

    selected, valid: (N,) bool; cursor: an iid. `y_down`: 90 degrees points down on the screen.
    """

    sim: Floats
    truth: Floats
    real: Floats
    selected: Bools
    valid: Bools
    y_down: bool = True
    cursor: int | None = None
    mark: BrushShape | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Headings:
    """One panel: counts per bin from -180 degrees on, of the selected and of all valid.

    mean: circular mean of the selected in degrees, -180 .. 180, and their resultant length 0 .. 1;
    NaN where none is selected. cursor: degrees, or None.
    """

    highlighted: Counts
    total: Counts
    mean: float
    resultant: float
    cursor: float | None


@dataclass(frozen=True, slots=True, eq=False)
class OrientationModel:
    """The panels in the order of NAMES, and the counts of a bar of full length.

    peak: of the selected. whole: of all valid instances. Grey bars show all instances, scaled by
    the selected share: the bars of a selection that is independent of the heading.
    """

    panels: tuple[Headings, ...]
    peak: int
    whole: float

    def lengths(self, panel: Headings) -> tuple[Lengths, Lengths]:
        """Bars 0 .. 1 of the selected and of all."""
        return panel.highlighted / self.peak, panel.total / self.whole


def orientation_model(data: OrientationInput, count: int = BINS) -> OrientationModel:
    """Counts in `count` bins (a divisor of 72) and means of the three headings."""
    sides = (data.sim, data.truth, data.real)
    counted = _counts(sides, data.selected, data.valid)
    panels = tuple(
        Headings(
            highlighted.reshape(count, -1).sum(axis=1),
            total.reshape(count, -1).sum(axis=1),
            math.degrees(np.angle(vector)),
            abs(vector),
            _cursor(side, data),
        )
        for side, (highlighted, total, vector) in zip(sides, counted, strict=True)
    )
    selection = sum(int(panel.highlighted.sum()) for panel in panels)
    share = selection / sum(int(panel.total.sum()) for panel in panels) if selection else 1.0
    longest = max(float(panel.total.max()) * share for panel in panels)
    longest = max(1, math.ceil(longest), *(int(panel.highlighted.max()) for panel in panels))
    return OrientationModel(panels, longest, longest / share)


@cached_by_identity(16)
def _bins(headings: Floats) -> Bins:
    turned = np.degrees(np.asarray(headings, dtype=np.float64)) + 180
    turned = (turned - 360 * np.floor(turned / 360)) / WIDTH
    return bin_values(np.where(turned >= BINS, 0.0, turned), BINS)


@cached_by_identity(16)
def _directions(headings: Floats) -> NDArray[np.complex128]:
    """(72,) the mean unit vector of all headings in each bin, in single precision."""
    column = np.asarray(headings, dtype=np.float32)
    codes = _bins(headings).codes
    known = np.where(codes < BINS, column, 0.0)
    cosines = np.bincount(codes, np.cos(known), BINS + 1)[:BINS]
    sines = np.bincount(codes, np.sin(known), BINS + 1)[:BINS]
    number = np.maximum(np.bincount(codes, minlength=BINS + 1)[:BINS], 1)
    return np.asarray((cosines + 1j * sines) / number)


@cached_by_identity(4)
def _counts(
    sides: tuple[Floats, ...], selected: Bools, valid: Bools
) -> list[tuple[Counts, Counts, complex]]:
    """Counts of the selected and of all in 72 bins, and the selected's mean unit vector."""
    selection = selection_indices(selected, valid)
    counted = joint_histogram.joint_counts([_bins(side) for side in sides], selection)
    return [
        (highlighted, total, _mean(side, highlighted, selection))
        for side, (highlighted, total) in zip(sides, counted, strict=True)
    ]


def _cursor(column: Floats, data: OrientationInput) -> float | None:
    """The heading of the cursor's instance in degrees, None where unknown."""
    cursor = valid_cursor(data.cursor, data.valid)
    if cursor is None:
        return None
    heading = float(column[cursor])
    return wrap_degrees(math.degrees(heading)) if math.isfinite(heading) else None


def _units(column: Floats, iids: NDArray[np.intp]) -> NDArray[np.complex128]:
    """Unit vectors of some headings; those of all are cached where they are few."""
    if len(column) <= EXACTLY_UP_TO:
        return _all_units(column)[iids]
    return np.asarray(np.exp(1j * column[iids]))


@cached_by_identity(16)
def _all_units(column: Floats) -> NDArray[np.complex128]:
    return np.asarray(np.exp(1j * column))


def _mean(column: Floats, highlighted: Counts, selection: SelectionIndices) -> complex:
    """The mean unit vector of the selected."""
    number = int(highlighted.sum())
    if number == 0:
        return complex(math.nan, math.nan)
    if number <= EXACTLY_UP_TO:
        directions = _units(column, selection.members)
        return complex(directions[np.isfinite(directions)].mean())
    return complex((highlighted * _directions(column)).sum() / number)
