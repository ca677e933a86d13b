"""The extremes of a column, found without sorting it, are those of the sorted column."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from s2rstore.metrics.top_k import first_largest, top_k


def sorted_extremes(values: np.ndarray, base: np.ndarray, count: int, largest: bool) -> list[int]:
    rows = [i for i in range(values.size) if base[i] and not np.isnan(values[i])]
    rows.sort(key=lambda i: (-values[i] if first_largest else values[i], i))
    return sorted(rows[:count])


@given(
    values=st.lists(st.sampled_from([0.0, 1.0, 1.5, -2.0, np.nan, np.inf, -np.inf]), max_size=30),
    seed=st.integers(0, 99), count=st.integers(0, 35), largest=st.booleans(),
)  # fmt: skip
def test_small_columns(values: list[float], seed: int, count: int, largest: bool) -> None:
    column = np.array(values, dtype=np.float64)
    base = np.random.default_rng(seed).random(column.size) < 0.8
    found = np.flatnonzero(top_k(column, base, count, first_largest))
    assert found.tolist() == sorted_extremes(column, base, count, first_largest)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**31), share=st.sampled_from([0, 1e-5, 0.01, 0.15, 0.5, 0.999, 1, 1.2]),
    digits=st.sampled_from([0, 1, 12]), kind=st.sampled_from(["float32", "float64"]),
    known=st.sampled_from([0.0005, 0.5, 1.0]), ordered=st.booleans(), largest=st.booleans(),
)  # fmt: skip
def test_large_columns(
    seed: int, share: float, digits: int, kind: str, known: float, ordered: bool, largest: bool
) -> None:
    rng = np.random.default_rng(seed)
    n = 90_000
    values = np.round(rng.gamma(2, 1, n), digits).astype(kind)
    if ordered:
        values.sort()
    values[rng.integers(0, n, 50)] = np.nan
    values[rng.integers(0, n, 5)] = np.inf
    base = rng.random(n) < known
    count = int(share * base.sum())
    found = np.flatnonzero(top_k(values, base, count, first_largest))
    keys = -values if first_largest else values
    rows = np.flatnonzero(base & ~np.isnan(values))
    wanted = rows[np.argsort(keys[rows], kind="stable")][:count]
    assert found.tolist() == np.sort(wanted).tolist()


@pytest.mark.parametrize("largest", [True, False])
def test_a_sample_that_misleads_does_no_harm(largest: bool) -> None:
    values = np.zeros(200_000)
    values[1::2] = np.arange(100_000)  # every sampled row is a zero or rises with its place
    base = np.ones(values.size, dtype=bool)
    for count in (1, 777, 150_000):
        found = np.flatnonzero(top_k(values, base, count, first_largest))
        wanted = np.argsort(-values if first_largest else values, kind="stable")[:count]
        assert found.tolist() == np.sort(wanted).tolist()


def test_the_largest_of_some_rows_is_their_first_known_one() -> None:
    values = np.array([0.0, 2.0, 0.0, 5.0, 5.0, np.nan])
    assert first_largest(values, np.arange(6)) == 3
    assert first_largest(values, np.arange(3)) == 1
    assert first_largest(values, np.array([5])) is None
    assert first_largest(values, np.array([2, 5])) == 2
    assert first_largest(values, np.arange(0)) is None
