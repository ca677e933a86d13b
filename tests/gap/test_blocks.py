"""Blocks and random halves for trajectories of all lengths."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rtools.common.blocks import Blocks, split_into_blocks
from s2rtools.gap.instance_selection import random_blocks, random_halves
from s2rtools.gap.visual.low_dimensional_samples import principal_components
from s2rtools.gap.visual.split_half_metrics import split_half_metrics


def blocks_of(sizes: list[int]) -> Blocks:
    """Blocks of trajectories with these lengths."""
    return split_into_blocks(np.repeat(np.arange(len(sizes)), sizes).astype(np.int32))


@given(st.lists(st.integers(1, 120), min_size=1, max_size=40), st.integers(0, 1000))
def test_halves_are_disjoint_and_equally_large(sizes: list[int], seed: int) -> None:
    blocks = blocks_of(sizes)
    label = np.repeat(np.arange(blocks.count), blocks.sizes.astype(int))
    for a, b in random_halves(blocks, 3, seed):
        assert a.size == b.size >= (sum(sizes) - blocks.sizes.max()) / 2
        assert not set(label[a]) & set(label[b])


@pytest.mark.parametrize("sizes", [[300, 3], [35, 1, 1, 1, 1, 1], [1] * 40, [40], [3, 300, 2]])
def test_very_unequal_trajectories_have_results(sizes: list[int]) -> None:
    n = sum(sizes)
    sim, real = np.random.default_rng(0).normal(size=(2, n, 4)) + np.array([[[1.0]], [[0.0]]])
    result = split_half_metrics(
        sim, real, blocks_of(sizes), 1, {"pca": principal_components(sim, real, 2)}
    )
    assert result["n"] >= 15
    assert result["kid"]["value"] > result["kid"]["floor"]


@pytest.mark.parametrize(
    ("sizes", "by_trajectory"),
    [
        ([20] * 6, True),
        ([20] * 5, False),
        ([100, 10, 10, 10, 10, 10], False),
        ([9] * 40, True),
        ([30, 10, 20, 25, 15, 20], True),
    ],
)
def test_whole_trajectories_are_units_if_there_are_enough(
    sizes: list[int], by_trajectory: bool
) -> None:
    blocks = blocks_of(sizes)
    assert blocks.by_trajectory == by_trajectory
    assert blocks.unit_count == (len(sizes) if by_trajectory else blocks.count)


def test_random_blocks_keep_their_trajectories() -> None:
    blocks = blocks_of([20] * 8)
    rows, part = random_blocks(blocks, 100, 3)
    assert rows.size == part.start[-1] <= 100
    assert np.array_equal(rows[part.start[:-1]] // 20, part.trajectory)
