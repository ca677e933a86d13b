"""Counts, sums and medians of selections per bin, fast enough for every key press.

A column is turned once into bin codes, one per instance, which are cached as long as the column
lives. A selection is then counted by one `bincount` over the smaller of the selected and the
unselected instances; the other one follows by subtraction from the totals.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.identity_cache import cached_by_identity

Bools = NDArray[np.bool_]
Codes = NDArray[np.unsignedinteger]
Counts = NDArray[np.intp]
Floats = NDArray[np.floating]
Sums = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SelectionIndices:
    """A selection within a base population, stored as the shorter list of iids.

    `indices` are the selected iids, or, if `inverted`, the unselected ones. `base`: (N,) bool.
    """

    base: Bools
    indices: NDArray[np.intp]
    inverted: bool

    @property
    def members(self) -> NDArray[np.intp]:
        """The selected iids, ascending."""
        if not self.inverted:
            return self.indices
        inside = self.base.copy()
        inside[self.indices] = False
        return np.flatnonzero(inside)


@dataclass(frozen=True, slots=True, eq=False)
class Bins:
    """codes: (N,) unsigned, 0 .. count - 1; `count` marks instances in no bin."""

    codes: Codes
    count: int


@cached_by_identity(8)
def selection_indices(selected: Bools, base: Bools) -> SelectionIndices:
    """Convert masks (N,) to indices; the same arrays give the same object."""
    inside, population = np.asarray(selected, dtype=np.bool_), np.asarray(base, dtype=np.bool_)
    highlighted = inside & population
    total = int(np.count_nonzero(population))
    if 2 * int(np.count_nonzero(highlighted)) <= total:
        return SelectionIndices(population, np.flatnonzero(highlighted), False)
    return SelectionIndices(population, np.flatnonzero(population & ~highlighted), True)


def bin_values(places: NDArray[np.floating], count: int) -> Bins:
    """Bin positions (N,) given in units of bins; NaN and values outside 0 .. count get no bin."""
    places = np.asarray(places)
    with np.errstate(invalid="ignore"):
        inside = (places >= 0) & (places < count)
    codes = np.where(inside, places, count)
    return Bins(codes.astype(np.uint16 if count < 1 << 16 else np.uint32), count)


def joint_bins(first: Bins, second: Bins) -> Bins:
    """Combine two columns: code = first * second.count + second, no bin where either has none."""
    count = first.count * second.count
    wide = first.codes.astype(np.uint32) * np.uint32(second.count) + second.codes
    outside = (first.codes == first.count) | (second.codes == second.count)
    wide[outside] = count
    return Bins(wide.astype(np.uint16 if count < 1 << 16 else np.uint32), count)


def count_selected(column: Bins, selection: SelectionIndices) -> tuple[Counts, Counts]:
    """Count per bin, (count,) each: the selected, and the whole base population."""
    total = _totals(column.codes, column.count, selection.base)
    part = _count(take(column.codes, selection.indices), column.count)
    return (total - part if selection.inverted else part), total


def take(column: NDArray[Any], iids: NDArray[np.intp]) -> NDArray[Any]:
    """column[iids] without bounds checks, which takes half the time."""
    return column.take(iids, axis=0, mode="clip")


@cached_by_identity(64)
def _totals(codes: Codes, size: int, base: Bools) -> Counts:
    total = _count(codes[np.asarray(base, dtype=np.bool_)], size)
    total.setflags(write=False)
    return total


def _count(codes: NDArray[np.generic], size: int) -> Counts:
    return np.bincount(codes, minlength=size + 1)[:size]


def sum_selected(column: Bins, weights: NDArray[np.floating], selection: SelectionIndices) -> Sums:
    """Sum `weights` (N,) of the selected per bin, (count,); they must be finite in every bin."""
    part = _weighted_counts(column, weights, selection.indices)
    if not selection.inverted:
        return part
    return _base_sums(column.codes, column.count, weights, selection.base) - part


@cached_by_identity(16)
def _base_sums(codes: Codes, size: int, weights: Floats, base: Bools) -> Sums:
    members = np.flatnonzero(base)
    column = Bins(codes, size)
    return _weighted_counts(column, np.asarray(weights, dtype=np.float64), members)


def _weighted_counts(
    column: Bins, weights: NDArray[np.floating], members: NDArray[np.intp]
) -> Sums:
    codes = take(column.codes, members)
    parts = np.asarray(take(weights, members), dtype=np.float64)
    total = np.bincount(codes, parts, minlength=column.count + 1)[: column.count]
    return np.asarray(total, dtype=np.float64)


def occupied_bins(column: Bins) -> tuple[Bins, NDArray[np.intp]]:
    """Renumber the bins that are not empty; also returns the old number of each."""
    numbers = np.flatnonzero(_count(column.codes, column.count))
    places = np.full(column.count + 1, len(numbers), dtype=np.uint32)
    places[numbers] = np.arange(len(numbers), dtype=np.uint32)
    wide = places.astype(np.uint16) if len(numbers) < 1 << 16 else places
    return Bins(wide[column.codes], len(numbers)), numbers


def median_selected(
    values: Floats, column: Bins, highlighted: Counts, selected: Bools, valid: Bools
) -> float:
    """The median of the selected valid values (N,), NaN without any.

    `column` holds bins that increase with the values, `highlighted` the selected per bin: only the
    instances in the bin of the median are examined.
    """
    number = int(highlighted.sum())
    if not number:
        return math.nan
    order, starts = _sorted(values, column.codes, column.count)
    ends = np.cumsum(highlighted)
    places = np.array([(number - 1) // 2, number // 2])
    first, last = np.searchsorted(ends, places, side="right").tolist()
    inside = order[starts[first] : starts[last + 1]]
    members = np.flatnonzero((selected & valid)[inside])
    middle = inside[members[places - (ends[first] - highlighted[first])]]
    return float(values[middle].mean())


@cached_by_identity(16)
def _sorted(values: Floats, codes: Codes, count: int) -> tuple[NDArray[np.int32], Counts]:
    """All iids sorted by value, those without a bin last; and the start of each bin."""
    sizes = np.bincount(codes, minlength=count + 1)
    return _by_value(values), np.concatenate([[0], np.cumsum(sizes)])


@cached_by_identity(16)
def _by_value(values: Floats) -> NDArray[np.int32]:
    return np.argsort(values).astype(np.int32)


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
    table, totals = _table(keys), _joint_totals(keys, selection.base)
    parts = _margins(_joint_count(table, selection.indices), table)
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
def _joint_totals(columns: tuple[tuple[Codes, int], ...], base: NDArray[np.bool_]) -> list[Counts]:
    table = _table(columns)
    return _margins(_joint_count(table, np.flatnonzero(base)), table)


def _joint_count(table: _Table, iids: Places) -> Counts:
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
