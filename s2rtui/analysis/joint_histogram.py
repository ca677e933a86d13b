"""Several columns counted together: the codes of an instance lie side by side, gathered once.

Of many instances, columns are joined: counted once in the combinations of bins that occur. Of few
it takes longer to sum up the combinations than to count each column.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import (
    Bins,
    Codes,
    Counts,
    SelectionIndices,
    joint_bins,
    occupied_bins,
    take,
)
from s2rtui.analysis.identity_cache import ArrayKey, cached_by_identity

LARGEST = 1 << 14
"""Combinations that occur up to which one pass is faster than one per column."""
WIDEST = 1 << 20
"""Combinations that could occur up to which it is worth to look."""
FEW = 1 << 15
"""Instances up to which no columns are joined."""
PIECE = 1 << 15
Places = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """Columns joined: one code per instance; `bins` are the columns' own by code, (codes,) each."""

    codes: Codes
    bins: tuple[Places, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """All groups: codes (N, groups), each group's after those of the one before, `size` together.

    `margins`: for each column where its group's codes lie, and the bin of each, None where the
    codes are the bins; `counts` are how many bins the columns have.
    """

    codes: Codes
    size: int
    margins: tuple[tuple[slice, Places | None], ...]
    counts: tuple[int, ...]


def joint_counts(
    columns: Sequence[Bins], selection: SelectionIndices
) -> list[tuple[Counts, Counts]]:
    """Counts as `bins.count` gives them, for each column."""
    keys = tuple((ArrayKey(column.codes), column.count) for column in columns)
    table, totals = _table(keys), _totals(keys, ArrayKey(selection.base))
    parts = _margins(_count(table, selection.indices), table)
    if selection.inverted:
        parts = [total - part for part, total in zip(parts, totals, strict=True)]
    return list(zip(parts, totals, strict=True))


@cached_by_identity(16)
def _table(columns: tuple[tuple[ArrayKey, int], ...]) -> _Table:
    groups: list[_Group] = []
    for same, count in columns:
        alone = _Group(np.asarray(same.array), (np.arange(count + 1),))
        groups += _joined(groups.pop(), alone) if groups else [alone]
    ends = np.cumsum([0, *(group.bins[0].size for group in groups)]).tolist()
    kind = np.uint16 if ends[-1] <= 1 << 16 else np.uint32
    codes: Codes = np.empty((len(groups[0].codes), len(groups)), dtype=kind)
    margins: list[tuple[slice, Places | None]] = []
    for place, (group, start, stop) in enumerate(zip(groups, ends, ends[1:], strict=False)):
        codes[:, place] = group.codes
        codes[:, place] += kind(start)
        own = group.bins if len(group.bins) > 1 else (None,)
        margins += [(slice(start, stop), bins) for bins in own]
    return _Table(codes, ends[-1], tuple(margins), tuple(count for _, count in columns))


def _joined(first: _Group, second: _Group) -> list[_Group]:
    """Both in one, where that is worth it."""
    sizes = first.bins[0].size, second.bins[0].size
    if len(first.codes) <= FEW or sizes[0] * sizes[1] > WIDEST:
        return [first, second]
    both, held = occupied_bins(
        joint_bins(Bins(first.codes, sizes[0]), Bins(second.codes, sizes[1]))
    )
    if both.count > LARGEST:
        return [first, second]
    left, right = np.divmod(held, sizes[1])
    parts = *(own[left] for own in first.bins), *(own[right] for own in second.bins)
    return [_Group(both.codes, parts)]


@cached_by_identity(16)
def _totals(columns: tuple[tuple[ArrayKey, int], ...], base: ArrayKey) -> list[Counts]:
    table = _table(columns)
    return _margins(_count(table, np.flatnonzero(np.asarray(base.array))), table)


def _count(table: _Table, iids: Places) -> Counts:
    """Counts of all groups' codes, (size,), in pieces that stay in the processor's caches."""
    found = np.zeros(table.size, dtype=np.intp)
    for start in range(0, iids.size, PIECE):
        codes = take(table.codes, iids[start : start + PIECE])
        found += np.bincount(codes.ravel(), minlength=table.size)
    return found


def _margins(found: Counts, table: _Table) -> list[Counts]:
    """Per column its counts over all others of its group, without those in no bin."""
    parts: list[Counts] = []
    for (held, own), count in zip(table.margins, table.counts, strict=True):
        part = found[held]
        if own is not None:
            part = np.rint(np.bincount(own, part, count + 1)).astype(np.intp)
        parts.append(part[:count])
    return parts
