"""Medians of selections without sorting them: columns are sorted once, bins point into them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import Bins, Bools
from s2rtui.analysis.identity_cache import ArrayKey, cached_by_identity

Floats = NDArray[np.floating]

Counts = NDArray[np.intp]


def median(values: Floats, column: Bins, lit: Counts, selected: Bools, valid: Bools) -> float:
    """The median of the selected and valid, NaN where none is.

    `column` are bins that grow with the values, `lit` their counts of the selected; only the
    instances of the bin that holds the median are looked at.
    """
    number = int(lit.sum())
    if not number:
        return math.nan
    order, starts = _sorted(ArrayKey(values), ArrayKey(column.codes), column.count)
    ends = np.cumsum(lit)
    places = np.array([(number - 1) // 2, number // 2])
    first, last = np.searchsorted(ends, places, side="right").tolist()
    inside = order[starts[first] : starts[last + 1]]
    members = np.flatnonzero((selected & valid)[inside])
    middle = inside[members[places - (ends[first] - lit[first])]]
    return float(values[middle].mean())


@cached_by_identity(16)
def _sorted(values: ArrayKey, codes: ArrayKey, count: int) -> tuple[NDArray[np.int32], Counts]:
    """All iids by value, those of no bin last; and where each bin starts."""
    sizes = np.bincount(np.asarray(codes.array), minlength=count + 1)
    return _by_value(values), np.concatenate([[0], np.cumsum(sizes)])


@cached_by_identity(16)
def _by_value(values: ArrayKey) -> NDArray[np.int32]:
    return np.argsort(np.asarray(values.array)).astype(np.int32)
