"""Block bootstrap draws and random halves for trajectories of all lengths."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from s2rstore.metrics.bootstrap import (
    Blocks,
    block_counts,
    corrected,
    mean_replicates,
    split_into_blocks,
)

from s2rtools.gap import defaults
from s2rtools.gap.axis_result import GapSettings
from s2rtools.gap.instance_selection import bootstrap_note, random_blocks, random_halves
from s2rtools.gap.visual.kid import block_mmd
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
def test_whole_trajectories_are_drawn_if_there_are_enough(
    sizes: list[int], by_trajectory: bool
) -> None:
    blocks = blocks_of(sizes)
    counts = block_counts(blocks, GapSettings(50, 1))
    assert blocks.by_trajectory == by_trajectory
    assert blocks.unit_count == (len(sizes) if by_trajectory else blocks.count)
    assert ("whole trajectories" in bootstrap_note(blocks)) == by_trajectory
    distinct_counts = [
        len(np.unique(counts[:, blocks.trajectory == t], axis=1).T) for t in range(len(sizes))
    ]
    assert (distinct_counts == [1] * len(sizes)) == by_trajectory
    assert blocks.ungrouped().unit_count == blocks.count


def test_random_blocks_keep_their_trajectories() -> None:
    blocks = blocks_of([20] * 8)
    rows, part = random_blocks(blocks, 100, 3)
    assert rows.size == part.start[-1] <= 100
    assert np.array_equal(rows[part.start[:-1]] // 20, part.trajectory)


def test_mmd_replicates_contain_the_pairs_of_each_drawn_copy() -> None:
    rng = np.random.default_rng(1)
    blocks = split_into_blocks(np.repeat(np.arange(6), 12).astype(np.int32), 4)
    pair = block_mmd(rng.normal(1, 1, size=(72, 3)), rng.normal(size=(72, 3)), blocks)
    drawn_trajectories = [0, 0, 0, 2, 4, 4]
    rows = [
        (copy, b)
        for copy, t in enumerate(drawn_trajectories)
        for b in np.flatnonzero(blocks.trajectory == t)
    ]
    total, count = 0.0, 0.0
    for copy, a in rows:
        for other, b in rows:
            if copy == other or drawn_trajectories[copy] != drawn_trajectories[other]:
                total += pair.excess[a, b]
                count += pair.pairs[a, b]
    counts = np.bincount(drawn_trajectories, minlength=6)[blocks.trajectory].astype(float)
    result = pair.replicates(counts[None, :])
    expected = corrected(np.array([total / count]), pair.value(), 6)
    assert result == pytest.approx(expected)


def test_intervals_cover_the_mean_of_trajectories_with_different_levels() -> None:
    rng = np.random.default_rng(2)
    covered = {"trajectories": 0, "blocks": 0}
    blocks = blocks_of([30] * 8)
    for seed in range(200):
        values = np.repeat(rng.normal(size=8), 30) + rng.normal(size=240)
        for name, grouping in (("trajectories", blocks), ("blocks", blocks.ungrouped())):
            replicates = mean_replicates(values, grouping, GapSettings(200, seed))
            low, high = np.percentile(replicates, [2.5, 97.5])
            covered[name] += low <= 0 <= high
    assert covered["trajectories"] / 200 >= 0.9
    assert covered["blocks"] < covered["trajectories"]


def test_the_gate_uses_the_common_bootstrap_defaults() -> None:
    assert (GapSettings().replicates, GapSettings().seed) == (defaults.REPLICATES, defaults.SEED)
