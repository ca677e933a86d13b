import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from s2rtools.datasets.recordings.recorded_poses import (
    nearest_times,
    orthonormal,
    poses_at,
    poses_from_quaternions,
    usable_poses,
)


def turning(times: np.ndarray) -> np.ndarray:
    """A drive at 2 m/s along x that turns by 0.3 rad/s about z."""
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(np.outer(0.3 * times, [0, 0, 1])).as_matrix()
    poses[:, 0, 3] = 2 * times
    return poses


def test_poses_between_known_ones_are_interpolated():
    known = np.arange(0, 2, 0.1)
    times = np.array([0.0, 0.05, 0.333, 1.9])
    np.testing.assert_allclose(poses_at(times, known, turning(known), 0.2), turning(times))


def test_no_pose_is_made_up_across_a_gap_or_far_outside():
    known = np.array([0.0, 0.1, 5.0])
    found = poses_at(np.array([-0.05, -0.2, 2.0, 5.0, 5.3]), known, turning(known), 0.2)
    assert np.isfinite(found).all(axis=(1, 2)).tolist() == [True, False, False, True, False]


def test_without_known_poses_there_are_none():
    assert np.isnan(poses_at(np.zeros(2), np.zeros(0), np.zeros((0, 4, 4)), 1.0)).all()
    assert nearest_times(np.zeros(2), np.zeros(0), 1.0).tolist() == [-1, -1]


@given(
    arrays(np.float64, st.integers(1, 20), elements=st.floats(0, 10), unique=True),
    arrays(np.float64, st.integers(1, 20), elements=st.floats(-1, 11)),
    st.floats(0, 2),
)
def test_nearest_times_equal_a_full_search(known, times, tolerance):
    known = np.sort(known)
    found = nearest_times(times, known, tolerance)
    distances = np.abs(times[:, None] - known)
    for row, distance in zip(found, distances, strict=True):
        assert (row == -1) == (distance.min() > tolerance)
        if row >= 0:
            assert distance[row] == distance.min()


@given(arrays(np.float64, (3, 4), elements=st.floats(-1, 1)))
def test_quaternions_that_are_not_of_length_one_are_unusable(quaternions):
    poses = poses_from_quaternions(np.zeros((3, 3)), quaternions)
    proper = np.abs(np.linalg.norm(quaternions, axis=1) - 1) <= 1e-2
    assert (usable_poses(poses) == proper).all()


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e9])
def test_positions_that_are_no_places_are_unusable(value):
    poses = turning(np.arange(3.0))
    poses[1, 2, 3] = value
    assert usable_poses(poses).tolist() == [True, False, True]


def test_mirrored_rotations_are_unusable():
    poses = turning(np.arange(2.0))
    poses[1, :3, 0] *= -1
    assert usable_poses(poses).tolist() == [True, False]


def test_rounded_rotations_become_exact():
    poses = turning(np.arange(5.0))
    exact = orthonormal(np.round(poses, 4))
    np.testing.assert_allclose(exact, poses, atol=1e-3)
    products = np.swapaxes(exact[:, :3, :3], 1, 2) @ exact[:, :3, :3]
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(3), products.shape), atol=1e-12)
