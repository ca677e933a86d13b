"""The assignment of poses and times, against scipy's dense one and known pairs."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from s2rstore.geometry import angles
from s2rtools.datasets.pairing import pair_matching
from s2rtools.datasets.pairing.pair_matching import (
    Candidates,
    PoseTolerance,
    assign,
    match_poses,
    match_times,
)
from s2rtools.datasets.pairing.recording_pairs import parse_tolerance
from tests.support.refusals import refused

TOLERANCE = PoseTolerance(0.5, math.radians(20))


def costs(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """The cost of every pair (N, M), infinite beyond the tolerance."""
    distance = np.hypot(*(first[:, None, :2] - second[None, :, :2]).transpose(2, 0, 1))
    angle = angles.distance(first[:, None, 2], second[None, :, 2])
    cost = distance + TOLERANCE.distance / TOLERANCE.angle * angle
    return np.where((distance <= 0.5) & (angle <= TOLERANCE.angle), cost, np.inf)


def total(cost: NDArray[np.float64], a: NDArray[np.intp], b: NDArray[np.intp]) -> float:
    """The minimised sum: costs of pairs, and half of the largest cost for each point left."""
    free = cost.shape[0] + cost.shape[1] - 2 * len(a)
    return float(cost[a, b].sum() + TOLERANCE.cost / 2 * free)


def dense_total(cost: NDArray[np.float64]) -> float:
    """The smallest sum, by the dense assignment with a dummy partner for every point."""
    n, m = cost.shape
    square = np.zeros((n + m, n + m))
    square[:n, :m] = np.where(np.isfinite(cost), cost, 1e6)
    square[:n, m:] = square[n:, :m] = TOLERANCE.cost / 2
    a, b = linear_sum_assignment(square)
    return float(square[a, b].sum())


@given(
    n=st.integers(1, 14), m=st.integers(1, 14), seed=st.integers(0, 10_000),
    side=st.sampled_from([0.6, 1.5, 4.0]),
)  # fmt: skip
@pytest.mark.parametrize("dense_cells", [1 << 16, 0])
def test_the_total_cost_is_that_of_the_dense_assignment(dense_cells, n, m, seed, side):
    rng = np.random.default_rng(seed)
    first, second = (
        np.column_stack([rng.uniform(0, side, (size, 2)), rng.uniform(-0.6, 0.6, size)])
        for size in (n, m)
    )
    cost = costs(first, second)
    rows, columns = np.nonzero(np.isfinite(cost))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pair_matching, "_DENSE_CELLS", dense_cells)
        a, b = assign(Candidates(rows, columns, cost[rows, columns]), (n, m), TOLERANCE.cost)
        poses = match_poses(first, second, TOLERANCE)
    for found in ((a, b), poses):
        assert all(len(set(rows.tolist())) == len(rows) for rows in found)
        assert np.isfinite(cost[found]).all()
        assert total(cost, *found) == pytest.approx(dense_total(cost), abs=1e-6)


def test_a_chain_of_times_is_not_shifted_for_one_more_pair():
    a, b = match_times(np.array([0.0, 1.0]), np.array([1.0, 1.95]), 1.0)
    assert (a.tolist(), b.tolist()) == ([1], [0])


def test_headings_near_the_turn_are_near():
    first, second = np.array([[0, 0, np.pi - 0.01]]), np.array([[0, 0, -np.pi + 0.01]])
    assert len(match_poses(first, second, TOLERANCE)[0]) == 1
    assert len(match_poses(first, np.add(second, [0, 0, 1]), TOLERANCE)[0]) == 0


def test_equal_poses_of_a_robot_that_stands_still_are_all_paired():
    first, second = np.zeros((300, 3)), np.zeros((400, 3))
    a, b = match_poses(first, second, TOLERANCE)
    assert len(a) == len(set(b.tolist())) == 300


@pytest.mark.parametrize("counts", [(0, 3), (3, 0), (0, 0)])
def test_nothing_is_paired_without_images(counts):
    a, b = match_poses(np.zeros((counts[0], 3)), np.zeros((counts[1], 3)), TOLERANCE)
    assert len(a) == len(b) == 0


@pytest.mark.parametrize(("spread", "recall", "precision"), [(0.05, 1.0, 1.0), (0.5, 0.98, 0.98)])
def test_known_pairs_of_poses_that_are_apart_are_found(spread, recall, precision):
    """Images 1 m apart, a tenth of them missing on either side, poses off by up to `spread`."""
    rng = np.random.default_rng(3)
    n = 2000
    heading = np.cumsum(rng.normal(0, 0.1, n))
    truth = np.column_stack([np.cumsum(np.cos(heading)), np.cumsum(np.sin(heading)), heading])
    direction, length = rng.uniform(-np.pi, np.pi, n), rng.uniform(0.05, spread, n)
    moved = truth + np.column_stack(
        [length * np.cos(direction), length * np.sin(direction), rng.normal(0, 0.03, n)]
    )
    sims, reals = (rng.permutation(n)[: n * 9 // 10] for _ in range(2))
    a, b = match_poses(moved[sims], truth[reals], PoseTolerance(0.55, math.radians(15)))
    right = int((sims[a] == reals[b]).sum())
    known = len(set(sims.tolist()) & set(reals.tolist()))
    assert right / known >= recall
    assert right / len(a) >= precision


def test_times_are_paired_one_to_one_within_the_tolerance():
    first = np.array([0.0, 0.1, 0.2, np.nan, 5.0]) + 1.6e9
    second = np.array([0.21, 0.02, 0.12, 4.9]) + 1.6e9
    a, b = pair_matching.match_times(first, second, 0.05)
    assert list(zip(a.tolist(), b.tolist(), strict=True)) == [(0, 1), (1, 2), (2, 0)]


def test_tolerances_are_read_in_their_units():
    assert parse_tolerance("25cm, 0.5rad", "pose") == PoseTolerance(0.25, 0.5)
    assert parse_tolerance("50ms", "time") == pytest.approx(0.05)
    assert parse_tolerance(None, "name") is None
    assert parse_tolerance(None, "pose") == PoseTolerance(0.2, math.radians(10))


@pytest.mark.parametrize(
    ("text", "match"),
    [("0.2m", "pose"), ("0.2,10deg", "pose"), ("0.2m,0deg", "pose"), ("nanm,5deg", "pose"),
     ("1m,1m,5deg", "pose"), ("0.2m", "time"), ("0.1s", "name"), ("1e999s", "time")],
)  # fmt: skip
def test_other_tolerances_are_refused_in_one_line(text, match):
    with refused(match="--tolerance"):
        parse_tolerance(text, match)  # type: ignore[arg-type]
