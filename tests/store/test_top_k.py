"""Top-k selection without sorting equals selection from the sorted column."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.metrics.top_k import first_largest, top_k


@given(
    seed=st.integers(0, 2**31), share=st.sampled_from([0, 1e-5, 0.01, 0.15, 0.5, 0.999, 1, 1.2]),
    digits=st.sampled_from([0, 1, 12]), kind=st.sampled_from(["float32", "float64"]),
    base_share=st.sampled_from([0.0005, 0.5, 1.0]), ordered=st.booleans(), largest=st.booleans(),
    n=st.sampled_from([1, 5, 30, 90_000]),
)  # fmt: skip
def test_top_k_is_that_of_sorting(seed, share, digits, kind, base_share, ordered, largest, n):
    rng = np.random.default_rng(seed)
    values = np.round(rng.gamma(2, 1, n), digits).astype(kind)
    if ordered:
        values.sort()
    for special in (np.nan, np.inf, -np.inf):
        values[rng.integers(0, n, n // 1000 + 1)] = special
    base = rng.random(n) < base_share
    count = round(share * base.sum())
    selected = np.flatnonzero(top_k(values, base, count, largest))
    keys = -values if largest else values
    rows = np.flatnonzero(base & ~np.isnan(values))
    expected = rows[np.argsort(keys[rows], kind="stable")][:count]
    assert selected.tolist() == np.sort(expected).tolist()


@pytest.mark.parametrize("largest", [True, False])
def test_an_unrepresentative_sample_gives_the_correct_result(largest):
    values = np.zeros(200_000)
    values[1::2] = np.arange(100_000)  # every sampled row is 0 or increases with its index
    base = np.ones(values.size, dtype=bool)
    for count in (1, 777, 150_000):
        selected = np.flatnonzero(top_k(values, base, count, largest))
        expected = np.argsort(-values if largest else values, kind="stable")[:count]
        assert selected.tolist() == np.sort(expected).tolist()


def test_first_largest_returns_the_first_of_equal_values():
    values = np.array([0.0, 2.0, 0.0, 5.0, 5.0, np.nan])
    assert first_largest(values, np.arange(6)) == 3
    assert first_largest(values, np.arange(3)) == 1
    assert first_largest(values, np.array([5])) is None
    assert first_largest(values, np.array([2, 5])) == 2
    assert first_largest(values, np.arange(0)) is None
