"""Counts, sums, medians and ranks per bin compared with direct computation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.analysis import joint_histogram
from s2rtui.analysis import ranked_column as ranked
from s2rtui.analysis.binning import (
    bin_values,
    count_selected,
    joint_bins,
    occupied_bins,
    selection_indices,
    sum_selected,
)
from s2rtui.charts.map.paper import _overlap

SIZE = 40
masks = arrays.arrays(np.bool_, SIZE)
values = st.floats(-3, 9) | st.sampled_from([np.nan, np.inf, -np.inf])
weights = arrays.arrays(np.float64, SIZE, elements=st.floats(-100, 100))
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


@pytest.mark.parametrize(
    ("few", "largest", "piece"),
    [
        (SIZE, 0, joint_histogram.PIECE),
        (0, joint_histogram.LARGEST, 7),
        (0, 12, 7),
        (0, 1, joint_histogram.PIECE),
    ],
)
def test_margins_equal_the_counts_of_each_column(few, largest, piece, monkeypatch) -> None:
    monkeypatch.setattr(joint_histogram, "FEW", few)
    monkeypatch.setattr(joint_histogram, "LARGEST", largest)
    monkeypatch.setattr(joint_histogram, "PIECE", piece)

    @given(positions, positions, positions, masks, masks)
    def check(first, second, third, selected, base):
        columns = [bin_values(first, 3), bin_values(second, 5), bin_values(third, 1)]
        selection = selection_indices(selected, base)
        for column, (highlighted, total) in zip(
            columns, joint_histogram.joint_counts(columns, selection), strict=True
        ):
            expected = count_selected(column, selection)
            np.testing.assert_array_equal(highlighted, expected[0])
            np.testing.assert_array_equal(total, expected[1])

    check()


N = 60
columns = arrays.arrays(np.float64, N, elements=st.integers(-4, 9).map(float) | st.just(np.nan))
groupings = arrays.arrays(np.int64, N, elements=st.integers(0, 2))
member_masks = arrays.arrays(np.bool_, N)


@given(columns, groupings, member_masks, st.sampled_from([3, 7, 2048]))
def test_medians_and_ranks_are_those_of_the_sorted_members(
    values: np.ndarray, groups: np.ndarray, members: np.ndarray, bins: int
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ranked, "_RANK_BINS", bins)
        column = ranked.ranked_column(values, groups, 3)
    known = np.isfinite(values)
    chosen = ranked.select_ranks(column, selection_indices(members, known), members)
    for group in (None, 0, 1, 2):
        inside = members & known & (True if group is None else groups == group)
        expected = np.sort(values[inside])
        found = [chosen.value(rank, group) for rank in range(expected.size)]
        assert found == expected.tolist()
        if expected.size:
            assert chosen.median(group) == np.median(expected)
        else:
            assert np.isnan(chosen.median(group))
