"""Joint histograms have the same margins as separate histograms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.analysis import joint_histogram
from s2rtui.analysis.binning import bin_values, count_selected, selection_indices

SIZE = 40
positions = arrays.arrays(np.float64, SIZE, elements=st.floats(-2, 7) | st.just(np.nan))
masks = arrays.arrays(np.bool_, SIZE)


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
