"""Counts, sums, medians and ranks per bin compared with direct computation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.analysis import binning
from s2rtui.analysis import ranked_column as ranked
from s2rtui.analysis.binning import bin_values, count_selected, selection_indices

SIZE = 40
masks = arrays.arrays(np.bool_, SIZE)
values = st.floats(-3, 9) | st.sampled_from([np.nan, np.inf, -np.inf])
positions = arrays.arrays(np.float64, SIZE, elements=values)


@pytest.mark.parametrize(
    ("few", "largest", "piece"),
    [
        (SIZE, 0, binning.PIECE), (0, binning.LARGEST, 7), (0, 12, 7),
        (0, 1, binning.PIECE),
    ],
)  # fmt: skip
def test_counts_and_margins_equal_those_of_masks(few, largest, piece, monkeypatch):
    monkeypatch.setattr(binning, "FEW", few)
    monkeypatch.setattr(binning, "LARGEST", largest)
    monkeypatch.setattr(binning, "PIECE", piece)

    @given(positions, positions, positions, masks, masks)
    def check(first, second, third, selected, base):
        widths = (3, 5, 1)
        binned = [bin_values(*each) for each in zip((first, second, third), widths, strict=True)]
        selection = selection_indices(selected, base)
        counted = binning.joint_counts(binned, selection)
        for column, bins, counts in zip((first, second, third), binned, counted, strict=True):
            for found in (counts, count_selected(bins, selection)):
                for mask, numbers in zip((selected & base, base), found, strict=True):
                    assert numbers.tolist() == [
                        ((column >= index) & (column < index + 1) & mask).sum()
                        for index in range(numbers.size)
                    ]

    check()


N = 60
columns = arrays.arrays(np.float64, N, elements=st.integers(-4, 9).map(float) | st.just(np.nan))
groupings = arrays.arrays(np.int64, N, elements=st.integers(0, 2))
member_masks = arrays.arrays(np.bool_, N)


@given(columns, groupings, member_masks, st.sampled_from([3, 7, 2048]))
def test_medians_and_ranks_are_those_of_the_sorted_members(values, groups, members, bins):
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
