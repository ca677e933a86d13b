"""Instances as lines between the rows of a table, or as bands where they are many.

The values of a row are binned once per scale, and a selection is counted per bin, so that bands of
a million instances follow every key press.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import (
    Bins,
    Bools,
    Counts,
    SelectionIndices,
    joint_counts,
    selection_indices,
)
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.drawing.plot import Ink, Phrase
from s2rtui.drawing.scale import Floats, Scale

MOST_LINES = 60
"""More instances than this that are drawn alike become bands."""
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
"""The ends of the outer and the inner band, and the median between them."""
BAND_TEXT = "5 to 95 %, 25 to 75 %, median"
BINS = 64
"""Bins of a scale; within a bin instances count as evenly spread."""
_PIECE = 1 << 15
_SPARSE = np.array([[1, 0], [0, 0], [0, 1], [0, 0]], dtype=np.bool_)
"""The dots of a cell that the outer band has."""
Density = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class LineLayer:
    """Instances that are drawn alike. values: (N,) of each row. is_pale: of a paler ink."""

    values: tuple[Floats, ...]
    selection: SelectionIndices
    ink: Ink
    is_pale: bool = False

    @property
    def size(self) -> int:
        """The number of instances."""
        listed = self.selection.indices.size
        if not self.selection.inverted:
            return listed
        return _size(self.selection.base) - listed

    @property
    def is_banded(self) -> bool:
        return self.size > MOST_LINES

    def shares(self, scale: Scale) -> Density:
        """The place of every instance on the strip of each row, (rows, size) in 0 .. 1."""
        members = self.selection.members
        return np.clip(scale.fraction([column[members] for column in self.values]), 0.0, 1.0)

    def counts(self, scale: Scale, size: int = BINS) -> tuple[Counts, Counts]:
        """How many instances, and how many valid ones, each of `size` bins has, (rows, size)."""
        chosen = self.selection
        part, total = _counts(self.values, scale, size, chosen.base, chosen.indices)
        return (total - part if chosen.inverted else part), total

    def quantiles(self, scale: Scale, size: int = BINS) -> Density:
        """`QUANTILES` of each row as places on its strip, (rows, 5); NaN without instances."""
        edges = np.linspace(0.0, 1.0, size + 1)
        places = np.full((len(self.values), len(QUANTILES)), np.nan)
        for row, counts in zip(places, self.counts(scale, size)[0], strict=True):
            below = np.concatenate([[0], np.cumsum(counts)])
            if below[-1]:
                row[:] = np.interp(np.array(QUANTILES) * below[-1], below, edges)
        return places


@dataclass(frozen=True, slots=True, eq=False)
class RowLines:
    """Parallel coordinates: a line for each instance, from the strip of each row to the next one's.

    values: (N,) of each row; NaN interrupts a line, values beyond the scale are at its end.
    selected, valid: (N,); the selected ones are drawn in `ink`, the other valid ones in grey
    below them. trained: (N,) those of the selected that are paler; None where none is shown.
    cursor: an instance whose line is on top.
    """

    values: tuple[Floats, ...]
    selected: Bools
    valid: Bools
    ink: Ink
    trained: Bools | None = None
    cursor: int | None = None

    @property
    def layers(self) -> tuple[LineLayer, ...]:
        """The instances that are drawn alike, from the lowest to the topmost."""
        chosen = selection_indices(self.selected, self.valid)
        others = replace(chosen, inverted=not chosen.inverted)
        layers = [LineLayer(self.values, others, "unselected")]
        if self.trained is not None:
            trained, chosen = (
                selection_indices(part, self.valid) for part in _parts(self.selected, self.trained)
            )
            layers.append(LineLayer(self.values, trained, self.ink, is_pale=True))
        layers.append(LineLayer(self.values, chosen, self.ink))
        if self.cursor is not None:
            single = SelectionIndices(self.valid, np.array([self.cursor]), inverted=False)
            layers.append(LineLayer(self.values, single, "cursor"))
        return tuple(layers)

    @property
    def is_banded(self) -> bool:
        """Whether the selected instances, without the trained ones, are bands."""
        return [layer.is_banded for layer in self.layers if layer.ink == self.ink][-1]

    @property
    def legend(self) -> tuple[Phrase, ...]:
        """What the lines of the selected instances are."""
        phrases = [Phrase(f"{'bands' if self.is_banded else 'lines'}: {self.ink}", self.ink)]
        if self.trained is not None:
            phrases.append(Phrase("pale: trained on", self.ink, "trained"))
        return tuple(phrases)

    def at_cursor(self, row: int) -> float:
        """The value of the cursor's instance in a row; NaN where there is none."""
        return np.nan if self.cursor is None else float(self.values[row][self.cursor])


@cached_by_identity(8)
def _size(members: Bools) -> int:
    return int(np.count_nonzero(members))


@cached_by_identity(4)
def _parts(selected: Bools, trained: Bools) -> tuple[Bools, Bools]:
    """The selected instances that are trained, and those that are not."""
    return selected & trained, selected & ~trained


@cached_by_identity(4)
def _counts(
    columns: tuple[Floats, ...], scale: Scale, size: int, base: Bools, iids: NDArray[np.intp]
) -> tuple[Counts, Counts]:
    bins = [Bins(_binned(column, scale, size), size) for column in columns]
    counted = joint_counts(bins, SelectionIndices(base, iids, inverted=False))
    part, total = (np.stack(counts) for counts in zip(*counted, strict=True))
    return part, total


@cached_by_identity(64)
def _binned(values: Floats, scale: Scale, size: int) -> NDArray[np.unsignedinteger]:
    """The bin of each value, those beyond the scale in its outer bins; `size` for NaN."""
    codes = np.empty(len(values), dtype=np.min_scalar_type(size))
    for start in range(0, len(values), _PIECE):
        places = scale.fraction(values[start : start + _PIECE]) * size
        codes[start : start + _PIECE] = np.where(
            np.isnan(places), size, np.clip(places, 0, size - 1)
        )
    return codes


def layer_dots(layer: LineLayer, scale: Scale, width: int, step: int) -> Density:
    """A layer in `width` cells per row and `step` lines from row to row, (4 lines, 2 columns) each.

    Lines: how many cross a dot. Bands: 1 in some dots of the outer one, 2 in the inner one, 3 at
    the median. Where rows follow each other (`step` 1): bars up to four dots high, with the number
    of instances in each of their dots.
    """
    if step == 1:
        return _bars(layer, scale, width)
    draw, places = (
        (_band, layer.quantiles(scale)) if layer.is_banded else (_segments, layer.shares(scale))
    )
    parts = [draw(*ends, 4 * step, 2 * width) for ends in pairwise(2 * width * places)]
    edge = np.zeros((2, 2 * width))
    grid = np.concatenate([edge, *parts, edge])
    if layer.is_banded:
        grid[(grid == 1) & ~np.tile(_SPARSE, (len(grid) // 4, width))] = 0.0
    return grid


def _segments(first: Density, second: Density, rows: int, width: int) -> Density:
    """How many lines from the dots `first` (n,) of one row to those of the next cross a dot."""
    known = np.isfinite(first) & np.isfinite(second)
    start, stop = (np.minimum(ends[known], width - 1)[:, None] for ends in (first, second))
    edges = np.floor(start + (stop - start) * np.linspace(0, 1, rows + 1)).astype(np.intp)
    before, after = edges[:, :-1], edges[:, 1:]
    low, high = np.minimum(before, after) + (after < before), np.maximum(before, after)
    high -= after > before
    base, size = np.arange(rows) * (width + 1), rows * (width + 1)
    steps = np.bincount((low + base).ravel(), minlength=size)
    steps -= np.bincount((high + 1 + base).ravel(), minlength=size)
    return np.cumsum(steps.reshape(rows, width + 1), axis=1)[:, :width].astype(np.float64)


def _band(first: Density, second: Density, rows: int, width: int) -> Density:
    """The bands between the quantiles (5,) of one row and those of the next one."""
    grid = np.zeros((rows, width))
    if not (np.isfinite(first).all() and np.isfinite(second).all()):
        return grid
    along = ((np.arange(rows) + 0.5) / rows)[:, None]
    dots = np.minimum(np.floor(first + (second - first) * along), width - 1)
    columns = np.arange(width)
    for level, (left, right) in enumerate(((0, 4), (1, 3), (2, 2)), start=1):
        grid[(columns >= dots[:, left, None]) & (columns <= dots[:, right, None])] = level
    return grid


def _bars(layer: LineLayer, scale: Scale, width: int) -> Density:
    """Bars on each row; four dots stand for the largest number of valid instances at a dot."""
    part, total = _per_dot(np.stack(layer.counts(scale)), 2 * width)
    heights = np.ceil(4 * levels(part, float(total.max(initial=0.0))))
    grid = (heights[:, None] >= np.arange(4, 0, -1)[:, None]) * part[:, None]
    return grid.reshape(-1, 2 * width)


def _per_dot(counts: Counts, dots: int) -> Density:
    """Counts (..., BINS) as numbers of instances at each of `dots` dots, (..., dots)."""
    edges = np.linspace(0.0, BINS, dots + 1)
    bins = np.minimum(edges.astype(np.intp), BINS - 1)
    below = np.cumsum(counts, axis=-1) - counts
    return np.diff(below[..., bins] + (edges - bins) * counts[..., bins])


def levels(density: Density, peak: float) -> Density:
    """Convert counts to 0 .. 1 on a logarithmic scale, steeper for large peaks."""
    shares: Density = np.log1p(density) / np.log1p(max(peak, 1.0))
    return shares ** max(1.0, float(np.log10(max(peak, 1.0))) - 1)
