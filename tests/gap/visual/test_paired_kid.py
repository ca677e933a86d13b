"""The distance of paired images against all splits one by one, its intervals and its test."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from s2rstore.metrics.bootstrap import Blocks, block_counts, split_into_blocks
from s2rtools.gap.axis_result import GapSettings
from s2rtools.gap.instance_selection import random_halves
from s2rtools.gap.visual.kid import block_mmd, kernel_distance, polynomial_gram


def one_trajectory(n: int, length: int = 0) -> Blocks:
    return split_into_blocks(np.zeros(n, dtype=np.int32), length)


def brute(x: np.ndarray, y: np.ndarray, label: np.ndarray, chosen: tuple[int, ...]) -> float:
    """MMD^2 of x of the chosen blocks and y of the others, without pairs of one block."""
    inside = np.isin(label, chosen)
    a, b = x[inside], y[~inside]

    def mean(p: np.ndarray, at: np.ndarray) -> float:
        return float(polynomial_gram(p, p)[at[:, None] != at[None, :]].mean())

    cross = float(polynomial_gram(a, b).mean())
    return mean(a, label[inside]) + mean(b, label[~inside]) - 2 * cross


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([4, 6]), st.integers(1, 4))
def test_it_is_the_mean_over_all_splits_into_halves(seed: int, count: int, length: int) -> None:
    rng = np.random.default_rng(seed)
    n = count * length
    sim, real = rng.normal(0.5, 1, size=(n, 5)), rng.normal(size=(n, 5))
    cut = one_trajectory(n, length)
    label = np.repeat(np.arange(count), length)
    splits = list(combinations(range(count), count // 2))
    wanted = np.mean([brute(sim, real, label, chosen) for chosen in splits])
    assert block_mmd(sim, real, cut).value() == pytest.approx(wanted, rel=1e-9, abs=1e-9)
    floor = np.mean([brute(real, real, label, chosen) for chosen in splits])
    assert block_mmd(real, real, cut).value() == pytest.approx(floor, abs=1e-9)


def test_identical_images_give_the_floor_to_the_bit() -> None:
    real = np.random.default_rng(0).normal(size=(60, 8))
    cut = one_trajectory(60)
    counts = block_counts(cut, GapSettings(50, 1), min_units=2)
    same, floor = block_mmd(real.copy(), real, cut), block_mmd(real, real, cut)
    assert same.value() == floor.value() == 0.0
    assert np.array_equal(same.replicates(counts), floor.replicates(counts))
    assert same.swap_p(99, 1) == 1.0


def walk(rng: np.random.Generator, n: int, noise: float) -> np.ndarray:
    """Places of a robot, correlated from image to image."""
    places = rng.normal(size=(n, 4))
    for row in range(1, n):
        places[row] = noise * places[row] + np.sqrt(1 - noise**2) * places[row - 1]
    return places


def look(rng: np.random.Generator, places: np.ndarray, shift: float) -> np.ndarray:
    mix = np.random.default_rng(9).normal(size=(4, 16)) / 2
    return np.maximum(places @ mix + shift, 0) + 0.2 * rng.normal(size=(len(places), 16))


def test_it_is_unbiased_where_neighbours_are_alike_and_its_intervals_hold_the_truth() -> None:
    rng = np.random.default_rng(4)
    draw = [rng.normal(size=(2000, 4)) for _ in range(6)]
    truth = np.mean([kernel_distance(look(rng, p, 0.3), look(rng, p[::-1], 0.0)) for p in draw])
    held, values = 0, []
    for seed in range(150):
        places = walk(rng, 80, 0.8)
        cut = one_trajectory(80)
        pair = block_mmd(look(rng, places, 0.3), look(rng, places, 0.0), cut)
        values.append(pair.value())
        low, high = np.percentile(
            pair.replicates(block_counts(cut, GapSettings(300, seed), min_units=2)), [2.5, 97.5]
        )
        held += low <= truth <= high
    assert np.mean(values) == pytest.approx(truth, rel=0.1)
    assert held / 150 >= 0.87


def test_the_swap_test_is_fair_without_a_gap_and_sharp_with_one() -> None:
    rng = np.random.default_rng(5)
    fair = []
    for seed in range(200):
        places = walk(rng, 64, 0.8)
        pair = block_mmd(look(rng, places, 0.0), look(rng, places, 0.0), one_trajectory(64))
        fair.append(pair.swap_p(63 if seed % 2 else 199, seed))
    assert np.mean(np.array(fair) <= 0.05) == pytest.approx(0.05, abs=0.05)
    places = walk(rng, 64, 0.8)
    pair = block_mmd(look(rng, places, 0.5), look(rng, places, 0.0), one_trajectory(64))
    assert pair.swap_p(999, 1) == 2.0 ** (1 - pair.blocks)


def test_blocks_respect_trajectories_and_halves_are_disjoint_and_equal() -> None:
    codes = np.repeat([0, 1, 2], [13, 50, 4]).astype(np.int32)
    cut = split_into_blocks(codes)
    assert cut.start[0] == 0
    assert cut.start[-1] == 67
    for first, last in zip(cut.start[:-1], cut.start[1:], strict=True):
        assert len(set(codes[first:last])) == 1
    label = np.repeat(np.arange(cut.count), np.diff(cut.start))
    for a, b in random_halves(cut, 5, 1):
        assert a.size == b.size > 10
        assert not set(a) & set(b)
        assert len(set(label[a]) & set(label[b])) == 0
    drawn = block_counts(cut, GapSettings(20, 3), min_units=2)
    assert (drawn.sum(axis=1) == cut.count).all()
    assert np.array_equal(drawn, block_counts(cut, GapSettings(20, 3), min_units=2))
    assert split_into_blocks(np.zeros(0, np.int32)).count == 0
