"""Columns counted together are counted as each alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.plots import joint
from s2rtui.plots.bins import bins, choose, count

SIZE = 40
places = arrays.arrays(np.float64, SIZE, elements=st.floats(-2, 7) | st.just(np.nan))
masks = arrays.arrays(np.bool_, SIZE)


@pytest.mark.parametrize(
    ("few", "largest", "piece"),
    [(SIZE, 0, joint.PIECE), (0, joint.LARGEST, 7), (0, 12, 7), (0, 1, joint.PIECE)],
)
def test_margins_are_the_counts_of_each_column(few, largest, piece, monkeypatch) -> None:
    monkeypatch.setattr(joint, "FEW", few)
    monkeypatch.setattr(joint, "LARGEST", largest)
    monkeypatch.setattr(joint, "PIECE", piece)

    @given(places, places, places, masks, masks)
    def check(first, second, third, selected, base):
        columns = [bins(first, 3), bins(second, 5), bins(third, 1)]
        chosen = choose(selected, base)
        for column, (lit, total) in zip(columns, joint.counts(columns, chosen), strict=True):
            expected = count(column, chosen)
            np.testing.assert_array_equal(lit, expected[0])
            np.testing.assert_array_equal(total, expected[1])

    check()
