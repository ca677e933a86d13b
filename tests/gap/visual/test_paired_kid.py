"""The paired kernel distance compared with explicit splits; its intervals, test and blocks."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.intervals import Interval
from s2rtools.common.blocks import Blocks, split_into_blocks
from s2rtools.gap.instance_selection import random_blocks, random_halves
from s2rtools.gap.visual.divergence import principal_components
from s2rtools.gap.visual.feature_distances import block_mmd, kernel_distance, polynomial_gram
from s2rtools.gap.visual.split_half_metrics import split_half_metrics


def one_trajectory(n: int, length: int = 0) -> Blocks:
    return split_into_blocks(np.zeros(n, dtype=np.int32), length)


def split_distance(
    x: np.ndarray, y: np.ndarray, label: np.ndarray, chosen_blocks: tuple[int, ...]
) -> float:
    """MMD^2 between x of the chosen blocks and y of the others, without pairs inside a block."""
    inside = np.isin(label, chosen_blocks)
    a, b = x[inside], y[~inside]

    def mean(p: np.ndarray, at: np.ndarray) -> float:
        return float(polynomial_gram(p, p)[at[:, None] != at[None, :]].mean())

    cross = float(polynomial_gram(a, b).mean())
    return mean(a, label[inside]) + mean(b, label[~inside]) - 2 * cross


@given(st.integers(0, 10_000), st.sampled_from([4, 6]), st.integers(1, 4))
def test_the_value_is_the_mean_over_all_half_splits(seed, count, length):
    rng = np.random.default_rng(seed)
    n = count * length
    sim, real = rng.normal(0.5, 1, size=(n, 5)), rng.normal(size=(n, 5))
    blocks = one_trajectory(n, length)
    label = np.repeat(np.arange(count), length)
    splits = list(combinations(range(count), count // 2))
    expected = np.mean(
        [split_distance(sim, real, label, chosen_blocks) for chosen_blocks in splits]
    )
    assert block_mmd(sim, real, blocks).value() == pytest.approx(expected, rel=1e-9, abs=1e-9)
    floor = np.mean([split_distance(real, real, label, chosen_blocks) for chosen_blocks in splits])
    assert block_mmd(real, real, blocks).value() == pytest.approx(floor, abs=1e-9)


def test_identical_images_give_exactly_the_floor():
    real = np.random.default_rng(0).normal(size=(60, 8))
    blocks = one_trajectory(60)
    same, floor = block_mmd(real.copy(), real, blocks), block_mmd(real, real, blocks)
    assert same.value() == floor.value() == 0.0
    assert same.interval() == floor.interval() == Interval(0.0, 0.0, 0.0)
    assert same.swap_p(99, 1) == 1.0


def correlated_positions(rng: np.random.Generator, n: int, noise: float) -> np.ndarray:
    """Positions of a robot, correlated between images."""
    positions = rng.normal(size=(n, 4))
    for row in range(1, n):
        positions[row] = noise * positions[row] + np.sqrt(1 - noise**2) * positions[row - 1]
    return positions


def features_at(rng: np.random.Generator, positions: np.ndarray, shift: float) -> np.ndarray:
    mix = np.random.default_rng(9).normal(size=(4, 16)) / 2
    return np.maximum(positions @ mix + shift, 0) + 0.2 * rng.normal(size=(len(positions), 16))


def test_the_value_is_unbiased_and_its_intervals_cover_the_truth():
    rng = np.random.default_rng(4)
    pose_samples = [rng.normal(size=(2000, 4)) for _ in range(6)]
    truth = np.mean(
        [
            kernel_distance(features_at(rng, p, 0.3), features_at(rng, p[::-1], 0.0))
            for p in pose_samples
        ]
    )
    covered, values = 0, []
    for _ in range(150):
        positions = correlated_positions(rng, 80, 0.8)
        blocks = one_trajectory(80)
        pair = block_mmd(features_at(rng, positions, 0.3), features_at(rng, positions, 0.0), blocks)
        values.append(pair.value())
        found = pair.interval()
        covered += found.low <= truth <= found.high
    assert np.mean(values) == pytest.approx(truth, rel=0.1)
    assert covered / 150 >= 0.87


def test_the_swap_test_is_calibrated_and_powerful():
    rng = np.random.default_rng(5)
    p_values = []
    for seed in range(200):
        positions = correlated_positions(rng, 64, 0.8)
        pair = block_mmd(
            features_at(rng, positions, 0.0), features_at(rng, positions, 0.0), one_trajectory(64)
        )
        p_values.append(pair.swap_p(63 if seed % 2 else 199, seed))
    assert np.mean(np.array(p_values) <= 0.05) == pytest.approx(0.05, abs=0.05)
    positions = correlated_positions(rng, 64, 0.8)
    pair = block_mmd(
        features_at(rng, positions, 0.5), features_at(rng, positions, 0.0), one_trajectory(64)
    )
    assert pair.swap_p(999, 1) == 2.0 ** (1 - pair.blocks.count)


def test_blocks_stay_in_trajectories():
    codes = np.repeat([0, 1, 2], [13, 50, 4]).astype(np.int32)
    blocks = split_into_blocks(codes)
    assert blocks.start[0] == 0
    assert blocks.start[-1] == 67
    for first, last in zip(blocks.start[:-1], blocks.start[1:], strict=True):
        assert len(set(codes[first:last])) == 1
    assert split_into_blocks(np.zeros(0, np.int32)).count == 0


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
