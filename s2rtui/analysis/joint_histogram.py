"""Counts of several columns in one pass over the selection.

The codes of an instance lie side by side in memory. With many instances, columns are joined as
well and counted once per combination of bins that occurs; with few it is faster to count each.
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
from s2rtui.analysis.identity_cache import cached_by_identity

LARGEST = 1 << 14
"""Combinations that occur up to which one pass is faster than one per column."""
WIDEST = 1 << 20
"""Possible combinations up to which the occurring ones are looked for."""
FEW = 1 << 15
"""Up to this number of instances no columns are joined."""
PIECE = 1 << 15
Places = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """Joined columns: a code per instance; `bins` holds each column's bin by code, (codes,)."""

    codes: Codes
    bins: tuple[Places, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """All groups: codes (N, groups), each group offset by the sizes of those before it.

    `size` is the number of codes. `margins`: per column the slice of its group's codes and the bin
    of each code (None where codes are bins). `counts`: bins per column.
    """

    codes: Codes
    size: int
    margins: tuple[tuple[slice, Places | None], ...]
    counts: tuple[int, ...]


def joint_counts(
    columns: Sequence[Bins], selection: SelectionIndices
) -> list[tuple[Counts, Counts]]:
    """Count each column as `binning.count_selected` does."""
    keys = tuple((column.codes, column.count) for column in columns)
    table, totals = _table(keys), _totals(keys, selection.base)
    parts = _margins(_count(table, selection.indices), table)
    if selection.inverted:
        parts = [total - part for part, total in zip(parts, totals, strict=True)]
    return list(zip(parts, totals, strict=True))


@cached_by_identity(16)
def _table(columns: tuple[tuple[Codes, int], ...]) -> _Table:
    groups: list[_Group] = []
    for key, count in columns:
        alone = _Group(key, (np.arange(count + 1),))
        groups += _joined(groups.pop(), alone) if groups else [alone]
    ends = np.cumsum([0, *(group.bins[0].size for group in groups)]).tolist()
    kind = np.uint16 if ends[-1] <= 1 << 16 else np.uint32
    codes: Codes = np.empty((len(groups[0].codes), len(groups)), dtype=kind)
    margins: list[tuple[slice, Places | None]] = []
    for place, (group, start, stop) in enumerate(zip(groups, ends, ends[1:], strict=False)):
        codes[:, place] = group.codes
        codes[:, place] += kind(start)
        members = group.bins if len(group.bins) > 1 else (None,)
        margins += [(slice(start, stop), bins) for bins in members]
    return _Table(codes, ends[-1], tuple(margins), tuple(count for _, count in columns))


def _joined(first: _Group, second: _Group) -> list[_Group]:
    """Both groups as one where that is faster, else both."""
    sizes = first.bins[0].size, second.bins[0].size
    if len(first.codes) <= FEW or sizes[0] * sizes[1] > WIDEST:
        return [first, second]
    both, numbers = occupied_bins(
        joint_bins(Bins(first.codes, sizes[0]), Bins(second.codes, sizes[1]))
    )
    if both.count > LARGEST:
        return [first, second]
    left, right = np.divmod(numbers, sizes[1])
    parts = *(bins[left] for bins in first.bins), *(bins[right] for bins in second.bins)
    return [_Group(both.codes, parts)]


@cached_by_identity(16)
def _totals(columns: tuple[tuple[Codes, int], ...], base: NDArray[np.bool_]) -> list[Counts]:
    table = _table(columns)
    return _margins(_count(table, np.flatnonzero(base)), table)


def _count(table: _Table, iids: Places) -> Counts:
    """Count the codes of all groups, (size,), in pieces that fit into the processor's cache."""
    total = np.zeros(table.size, dtype=np.intp)
    for start in range(0, iids.size, PIECE):
        codes = take(table.codes, iids[start : start + PIECE])
        total += np.bincount(codes.ravel(), minlength=table.size)
    return total


def _margins(code_counts: Counts, table: _Table) -> list[Counts]:
    """The counts per column, summed over the other columns of its group."""
    parts: list[Counts] = []
    for (codes, bins), count in zip(table.margins, table.counts, strict=True):
        part = code_counts[codes]
        if bins is not None:
            part = np.rint(np.bincount(bins, part, count + 1)).astype(np.intp)
        parts.append(part[:count])
    return parts
