"""The largest or smallest values of a column, exactly and in few passes."""

from __future__ import annotations

import math
import operator
from typing import Any

import numpy as np
from numpy.typing import NDArray

_SAMPLE = 16_384
_SMALL = 4 * _SAMPLE


def top_k(
    values: NDArray[Any], base: NDArray[np.bool_], count: int, largest: bool
) -> NDArray[np.bool_]:
    """The `count` most extreme known values among `base`, ties by index; shape (n,).

    Values (n,) are floats; NaN is never chosen. A large column is not sorted: a sample gives two
    bounds around the last chosen value, and only values between them are compared.
    """
    if count <= 0:
        return np.zeros_like(base)
    bounds = _bounds(values, base, count, largest) if values.size > _SMALL else None
    if bounds is not None:
        chosen = _between(values, base, count, largest, bounds)
        if chosen is not None:
            return chosen
    chosen = np.zeros_like(base)
    chosen[_taken(values, np.flatnonzero(base & ~np.isnan(values)), count, largest)] = True
    return chosen


def first_largest(values: NDArray[np.float64], rows: NDArray[np.intp]) -> int | None:
    """The first of `rows` (ascending) with the largest known value, all at least 0; or None."""
    candidates = values[rows]
    candidates = np.where(candidates >= 0, candidates, -1.0)
    place = int(candidates.argmax()) if candidates.size else 0
    return int(rows[place]) if candidates.size and candidates[place] >= 0 else None


def _taken(
    values: NDArray[Any], rows: NDArray[np.intp], count: int, largest: bool
) -> NDArray[np.intp]:
    """The `count` most extreme of `rows` (ascending, none NaN)."""
    if count <= 0 or count >= rows.size:
        return rows[: max(0, count)]
    keys = -values[rows] if largest else values[rows]
    limit = np.partition(keys, count - 1)[count - 1]
    ahead = rows[keys < limit]
    return np.concatenate([ahead, rows[keys == limit][: count - ahead.size]])


def _bounds(
    values: NDArray[Any], base: NDArray[np.bool_], count: int, largest: bool
) -> tuple[float, float] | None:
    """Two values, the more extreme first, that likely enclose the last chosen one.

    None where the sample is too small.
    """
    step = values.size // _SAMPLE
    among = base[::step]
    sample = np.sort(values[::step][among])
    sample = sample[: np.searchsorted(sample, np.nan)]
    if sample.size < 64:
        return None
    if largest:
        sample = sample[::-1]
    place = count * np.count_nonzero(among) / (np.count_nonzero(base) or 1)
    slack = 4 * math.sqrt(place) + 8
    first, last = math.floor(place - slack), math.ceil(place + slack)
    beyond = math.inf if largest else -math.inf
    return (
        float(sample[min(first, sample.size - 1)]) if first >= 0 else beyond,
        float(sample[last]) if last < sample.size else -beyond,
    )


def _between(
    values: NDArray[Any],
    base: NDArray[np.bool_],
    count: int,
    largest: bool,
    bounds: tuple[float, float],
) -> NDArray[np.bool_] | None:
    """All beyond the first bound, and the most extreme between both; None where they miss."""
    beyond, reaches = (operator.gt, operator.ge) if largest else (operator.lt, operator.le)
    chosen = np.asarray(beyond(values, bounds[0]))
    chosen &= base
    middle = np.asarray(reaches(values, bounds[1]))
    middle &= base
    middle ^= chosen
    rest = count - int(np.count_nonzero(chosen))
    rows = np.flatnonzero(middle)
    if rest < 0 or (rest > rows.size and math.isfinite(bounds[1])):
        return None
    chosen[_taken(values, rows, rest, largest)] = True
    return chosen
