"""Exact order statistics of selections per group, fast enough for every key press.

A column is sorted once. A selection is then counted per bin of neighbouring ranks, and only the
values of the bin that holds the wanted rank are looked at.
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
"""Most bins of ranks. With those of groups they fit into 16 bits, which sort and count fast."""
_CODES = 1 << 16


@dataclass(frozen=True, slots=True, eq=False)
class RankedColumn:
    """A column in bins of group and rank: bin g * `ranks` + r holds the r-th smallest of group g.

    `ordered` are the iids by bin and within it by value, bin b from `start[b]` to `start[b + 1]`.
    """

    values: Floats
    bins: Bins
    ranks: int
    ordered: NDArray[np.int32]
    start: NDArray[np.intp]


def ranked_column(values: Floats, groups: NDArray[np.integer], count: int) -> RankedColumn:
    """Sort `values` (N,) for groups with codes (N,) 0 .. count - 1; NaN is in no bin."""
    known = np.flatnonzero(np.isfinite(values))
    by_value = known[np.argsort(values[known])]
    ranks = max(1, min(_RANK_BINS, (_CODES - 1) // count, by_value.size))
    kind: type[np.unsignedinteger[Any]] = np.uint16 if count * ranks < _CODES else np.uint32
    codes: Codes = np.full(values.size, count * ranks, dtype=kind)
    rank = np.arange(by_value.size) * ranks // max(1, by_value.size)
    codes[by_value] = groups[by_value].astype(np.int64) * ranks + rank
    ordered = by_value[np.argsort(codes[by_value], kind="stable")].astype(np.int32)
    start = np.searchsorted(codes[ordered], np.arange(count * ranks + 1))
    return RankedColumn(values, Bins(codes, count * ranks), ranks, ordered, start)


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
