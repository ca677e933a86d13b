"""Sums per bin compared with direct summation, for any relative size of the selection."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.analysis.binning import (
    bin_values,
    count_selected,
    occupied_bins,
    selection_indices,
    sum_selected,
)
from s2rtui.charts.map.paper import _overlap

SIZE = 40
masks = arrays.arrays(np.bool_, SIZE)
positions = arrays.arrays(np.float64, SIZE, elements=st.floats(-2, 8) | st.just(np.nan))
weights = arrays.arrays(np.float64, SIZE, elements=st.floats(-100, 100))


@given(positions, weights, masks, masks)
def test_sums_per_bin_equal_masked_sums(
    column: np.ndarray, numbers: np.ndarray, selected: np.ndarray, base: np.ndarray
) -> None:
    sums = sum_selected(bin_values(column, 6), numbers, selection_indices(selected, base))
    with np.errstate(invalid="ignore"):
        for index in range(6):
            inside = (column >= index) & (column < index + 1) & selected & base
            assert sums[index] == pytest.approx(numbers[inside].sum(), abs=1e-9)


@given(positions, masks, masks)
def test_occupied_bins_keep_their_counts(
    column: np.ndarray, selected: np.ndarray, base: np.ndarray
) -> None:
    bins = bin_values(column, 6)
    fewer, occupied = occupied_bins(bins)
    selection = selection_indices(selected, base)
    before, after = count_selected(bins, selection)[0], count_selected(fewer, selection)[0]
    assert (before[occupied] == after).all()
    assert before.sum() == after.sum()


@pytest.mark.parametrize(
    ("first", "second", "shared"),
    [
        ((0, 40), (30, 90), (30, 40)),
        ((0, 40), (50, 90), None),
        ((170, 190), (-190, -175), (170, 185)),
        ((-10, 10), (355, 375), (-5, 10)),
        ((0, 40), None, None),
    ],
)
def test_angular_intervals_overlap_across_360_degrees(first, second, shared) -> None:
    assert _overlap(first, second) == shared
