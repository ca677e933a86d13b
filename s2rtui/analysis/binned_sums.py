"""Sums of numbers per bin, beside the counts of `bins`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import Bins, Chosen, gathered
from s2rtui.analysis.identity_cache import ArrayKey, cached_by_identity

Floats = NDArray[np.float64]


def sums(column: Bins, weights: NDArray[np.floating], chosen: Chosen) -> Floats:
    """Sums per bin, (count,), of `weights` (N,) over the selected; all of a bin's are finite."""
    part = _sum(column, weights, chosen.few)
    if not chosen.inverted:
        return part
    base = ArrayKey(chosen.base)
    return _totals(ArrayKey(column.codes), column.count, ArrayKey(weights), base) - part


@cached_by_identity(16)
def _totals(codes: ArrayKey, size: int, weights: ArrayKey, base: ArrayKey) -> Floats:
    members = np.flatnonzero(np.asarray(base.array))
    column = Bins(np.asarray(codes.array), size)
    return _sum(column, np.asarray(weights.array, dtype=np.float64), members)


def _sum(column: Bins, weights: NDArray[np.floating], members: NDArray[np.intp]) -> Floats:
    codes = gathered(column.codes, members)
    parts = np.asarray(gathered(weights, members), dtype=np.float64)
    total = np.bincount(codes, parts, minlength=column.count + 1)[: column.count]
    return np.asarray(total, dtype=np.float64)


def total_of(weights: NDArray[np.floating], chosen: Chosen) -> float:
    """The sum of what is finite of `weights` (N,) over the selected."""
    part = float(gathered(_finite(ArrayKey(weights)), chosen.few).sum())
    return _total(ArrayKey(weights), ArrayKey(chosen.base)) - part if chosen.inverted else part


@cached_by_identity(16)
def _total(weights: ArrayKey, base: ArrayKey) -> float:
    return float(_finite(weights)[np.asarray(base.array)].sum())


@cached_by_identity(4)
def _finite(weights: ArrayKey) -> Floats:
    """The weights, 0 for what is not finite."""
    column = np.asarray(weights.array, dtype=np.float64)
    return np.where(np.isfinite(column), column, 0.0)


def occupied(column: Bins) -> tuple[Bins, NDArray[np.intp]]:
    """The bins that hold anything, renumbered, and the old number of each."""
    cached_by_identity = np.flatnonzero(
        np.bincount(column.codes, minlength=column.count + 1)[: column.count]
    )
    places = np.full(column.count + 1, len(cached_by_identity), dtype=np.uint32)
    places[cached_by_identity] = np.arange(len(cached_by_identity), dtype=np.uint32)
    wide = places.astype(np.uint16) if len(cached_by_identity) < 1 << 16 else places
    return Bins(wide[column.codes], len(cached_by_identity)), cached_by_identity
