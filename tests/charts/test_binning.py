"""Counts per bin compared with direct counting, for any relative size of the selection."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.analysis.binning import bin_values, count_selected, joint_bins, selection_indices

SIZE = 40
masks = arrays.arrays(np.bool_, SIZE)
values = st.floats(-3, 9) | st.sampled_from([np.nan, np.inf, -np.inf])
positions = arrays.arrays(np.float64, SIZE, elements=values)


@given(positions, masks, masks)
def test_counts_per_bin_equal_masked_counts(column, selected, base):
    bins = bin_values(column, 5)
    highlighted, total = count_selected(bins, selection_indices(selected, base))
    with np.errstate(invalid="ignore"):
        for index in range(5):
            inside = (column >= index) & (column < index + 1)
            assert highlighted[index] == (inside & selected & base).sum()
            assert total[index] == (inside & base).sum()


@given(masks, masks)
def test_members_are_the_selected_instances_of_the_base(selected, base):
    np.testing.assert_array_equal(
        selection_indices(selected, base).members, np.flatnonzero(selected & base)
    )


@given(positions, positions, masks)
def test_joint_bins_count_pairs(first, second, selected):
    base = np.ones(SIZE, dtype=np.bool_)
    highlighted, _ = count_selected(
        joint_bins(bin_values(first, 3), bin_values(second, 4)), selection_indices(selected, base)
    )
    with np.errstate(invalid="ignore"):
        first_bin, second_bin = np.floor(first), np.floor(second)
        for row in range(3):
            for column in range(4):
                expected = (selected & (first_bin == row) & (second_bin == column)).sum()
                assert highlighted[row * 4 + column] == expected


def test_many_bins_need_wider_codes():
    bins = bin_values(np.array([0.0, 69_999.5, 70_000.0]), 70_000)
    assert bins.codes.tolist() == [0, 69_999, 70_000]
