"""Circular statistics: bins of a full turn, and mean directions of many angles from counts."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import Bins, SelectionIndices, bin_values
from s2rtui.analysis.identity_cache import cached_by_identity

EXACTLY_UP_TO = 20_000
"""Up to this number, mean directions are exact; above it they are computed from bins."""


@cached_by_identity(16)
def turn_bins(angles: NDArray[np.floating], count: int) -> Bins:
    """The bin of each angle (N,) in radians, of `count` bins from -180 degrees on; NaN: none."""
    turned = np.degrees(np.asarray(angles, dtype=np.float64)) + 180
    turned = (turned - 360 * np.floor(turned / 360)) / 360 * count
    return bin_values(np.where(turned >= count, 0.0, turned), count)


def mean_direction(
    angles: NDArray[np.floating], counts: NDArray[np.intp], selection: SelectionIndices
) -> complex:
    """The mean unit vector of the selected angles; NaN without any.

    counts: (n,) the selected in each of n bins of `turn_bins`.
    """
    number = int(counts.sum())
    if number == 0:
        return complex(math.nan, math.nan)
    if number > EXACTLY_UP_TO:
        return complex((counts * _directions(angles, counts.size)).sum() / number)
    units = np.exp(1j * np.asarray(angles[selection.members], dtype=np.float64))
    return complex(units[np.isfinite(units)].mean())


@cached_by_identity(16)
def _directions(angles: NDArray[np.floating], count: int) -> NDArray[np.complex128]:
    """(count,) the mean unit vector of all angles in each bin, in single precision."""
    column = np.asarray(angles, dtype=np.float32)
    codes = turn_bins(angles, count).codes
    known = np.where(codes < count, column, 0.0)
    cosines = np.bincount(codes, np.cos(known), count + 1)[:count]
    sines = np.bincount(codes, np.sin(known), count + 1)[:count]
    number = np.maximum(np.bincount(codes, minlength=count + 1)[:count], 1)
    return np.asarray((cosines + 1j * sines) / number)
