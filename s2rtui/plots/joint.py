"""Several columns counted together: one pass over the selection instead of one per column."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce

import numpy as np

from s2rtui.plots.bins import Bins, Chosen, Counts, count, joined
from s2rtui.plots.same import Same, kept

LARGEST = 1 << 16
"""Cells of a joint table up to which one pass is faster than one per column."""


def counts(columns: Sequence[Bins], chosen: Chosen) -> list[tuple[Counts, Counts]]:
    """Counts as `bins.count` gives them, for each column; as many together as fit in a table."""
    found: list[tuple[Counts, Counts]] = []
    group: list[Bins] = []
    for column in columns:
        if group and math.prod(bins.count + 1 for bins in (*group, column)) > LARGEST:
            found += _together(group, chosen)
            group = []
        group.append(column)
    return found + _together(group, chosen)


def _together(columns: Sequence[Bins], chosen: Chosen) -> list[tuple[Counts, Counts]]:
    if len(columns) < 2:
        return [count(column, chosen) for column in columns]
    sizes = tuple(column.count + 1 for column in columns)
    table = _table(tuple(Same(column.codes) for column in columns), sizes)
    lit, total = count(table, chosen)
    parts = _margins(lit, sizes)
    return list(zip(parts, _totals(Same(total), sizes), strict=True))


@kept(16)
def _table(codes: tuple[Same, ...], sizes: tuple[int, ...]) -> Bins:
    """Every combination of bins; what is in no bin of a column has a place of its own."""
    columns = [Bins(np.asarray(same.array), size) for same, size in zip(codes, sizes, strict=True)]
    return reduce(joined, columns)


@kept(16)
def _totals(total: Same, sizes: tuple[int, ...]) -> list[Counts]:
    return _margins(np.asarray(total.array), sizes)


def _margins(table: Counts, sizes: tuple[int, ...]) -> list[Counts]:
    """Sums over all other columns, without the place for none."""
    parts: list[Counts] = []
    rest = table
    for size in reversed(sizes):
        rest = rest.reshape(-1, size)
        parts.append(rest.sum(axis=0)[:-1])
        rest = rest.sum(axis=1)
    return parts[::-1]
