"""Exact order statistics of selections per group, fast enough for every key press.

A column is divided once into bins of neighbouring ranks. A selection is then counted per bin, and
only the values of the bin that holds the wanted rank are looked at.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import (
    Bins,
    Bools,
    Codes,
    Counts,
    Floats,
    SelectionIndices,
    count_selected,
)

_RANK_BINS = 2048
"""Most bins of ranks. With the bins of groups they fit into 16 bits, which sort and count fast."""
_CODES = 1 << 16
_STEP_BITS = 18
"""First bits of a float32 that tell steps apart: 512 steps from a number to twice as much."""
_FEW, _FEW_STEP_BITS = 1 << 14, 12
"""Columns of up to this many values have fewer steps."""


@dataclass(frozen=True, slots=True, eq=False)
class RankedColumn:
    """A column in bins of group and rank: bin g * `ranks` + r holds values of group g.

    Values of bin r are smaller than those of bin r + 1; equal values are in one bin. `ordered` are
    the iids by bin, bin b from `start[b]` to `start[b + 1]`.
    """

    values: Floats
    bins: Bins
    ranks: int
    ordered: NDArray[np.int32]
    start: NDArray[np.intp]


def ranked_column(values: Floats, groups: NDArray[np.integer], count: int) -> RankedColumn:
    """Bin `values` (N,) for groups with codes (N,) 0 .. count - 1; NaN is in no bin.

    Bins hold about equally many values. They consist of steps of the floating-point scale, which
    are counted; sorting the values would take ten times as long.
    """
    bits = _STEP_BITS if values.size > _FEW else _FEW_STEP_BITS
    known, steps = np.isfinite(values), _float_steps(values, bits)
    counts = np.bincount(steps if known.all() else steps[known], minlength=1 << bits)
    size = int(counts.sum())
    ranks = max(1, min(_RANK_BINS, (_CODES - 1) // count, size))
    kind: type[np.unsignedinteger[Any]] = np.uint16 if count * ranks < _CODES else np.uint32
    rank_of_step = ((np.cumsum(counts) - counts) * ranks // max(1, size)).astype(kind)
    rank_of_step[counts == 0] = 0
    codes: Codes = groups.astype(kind) * kind(ranks) + rank_of_step[steps]
    codes[~known] = count * ranks
    ordered = np.argsort(codes, kind="stable").astype(np.int32)
    start = np.concatenate([[0], np.cumsum(np.bincount(codes, minlength=count * ranks))])
    return RankedColumn(values, Bins(codes, count * ranks), ranks, ordered, start)


def _float_steps(values: Floats, bits: int) -> NDArray[np.int32]:
    """Codes (N,) below 2 ** `bits` that ascend with values (N,): their first bits.

    Of float32 numbers as integers, negative ones descend; their other bits are inverted.
    """
    with np.errstate(over="ignore"):
        numbers = np.asarray(values, dtype=np.float32).view(np.int32)
    ascending = numbers ^ ((numbers >> 31) & np.int32(0x7FFFFFFF))
    return np.asarray((ascending >> (32 - bits)) + (1 << (bits - 1)), dtype=np.int32)


@dataclass(frozen=True, slots=True, eq=False)
class SelectedRanks:
    """Order statistics of the `members` (N,) of a selection; `counts` (groups, ranks) of them."""

    column: RankedColumn
    members: Bools
    counts: Counts

    def value(self, rank: int, group: int | None = None) -> float:
        """The value with the rank 0, 1, ... in a group, or among all members."""
        column = self.column
        counts = self.counts.sum(axis=0) if group is None else self.counts[group]
        below = np.cumsum(counts)
        place = int(np.searchsorted(below, rank, side="right"))
        groups = range(len(self.counts)) if group is None else (group,)
        bins = [code * column.ranks + place for code in groups]
        iids = np.concatenate([column.ordered[column.start[b] : column.start[b + 1]] for b in bins])
        values = np.sort(column.values[iids[self.members[iids]]])
        return float(values[rank - (below[place] - counts[place])])

    def median(self, group: int | None = None) -> float:
        """The median of a group, or of all members; NaN where there is none."""
        n = int(self.counts.sum() if group is None else self.counts[group].sum())
        if not n:
            return math.nan
        return (self.value((n - 1) // 2, group) + self.value(n // 2, group)) / 2


def select_ranks(
    column: RankedColumn, selection: SelectionIndices, members: Bools
) -> SelectedRanks:
    """Count a selection, whose mask is `members` (N,)."""
    counts, _ = count_selected(column.bins, selection)
    return SelectedRanks(column, members, counts.reshape(-1, column.ranks))
