"""Medians and ranks of selections per group, compared with sorting the selected values."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.analysis import ranked_column as ranked
from s2rtui.analysis.binning import selection_indices

N = 60
columns = arrays.arrays(np.float64, N, elements=st.integers(-4, 9).map(float) | st.just(np.nan))
groupings = arrays.arrays(np.int64, N, elements=st.integers(0, 2))
masks = arrays.arrays(np.bool_, N)


@given(columns, groupings, masks, st.sampled_from([3, 7, 2048]))
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
