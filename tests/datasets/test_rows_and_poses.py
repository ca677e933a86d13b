"""Rows of numbers in files, and poses of recordings at the times of images."""

import os
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from s2rstore.errors import RequestError
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.tables.numeric_rows import (
    NumericRows,
    in_time_order,
    read_matrix,
    read_numbers,
    read_stamped_names,
)
from s2rtools.datasets.recording import trajectory_name
from s2rtools.datasets.recordings.recorded_files import NumberedFiles
from s2rtools.datasets.recordings.recorded_poses import (
    nearest_times,
    poses_at,
    poses_from_quaternions,
    poses_near,
    usable_poses,
)
from tests.datasets.layouts.recordings import drive


@given(st.lists(st.one_of(st.floats(), st.sampled_from([0.0, 1.0, 2.0])), max_size=20))
def test_times_are_sorted_and_each_row_is_kept_or_reported(times):
    rows = NumericRows("t", np.array(times).reshape(-1, 1), np.arange(1, len(times) + 1))
    issues: list[InputIssue] = []
    order = in_time_order(rows, issues)
    found = rows.values[order, 0]
    assert (np.diff(found) > 0).all()
    assert set(found.tolist()) == {time for time in times if np.isfinite(time)}
    left_out = [issue for issue in issues if issue.kind != "times not in order"]
    assert len(order) + len(left_out) == len(times)
    first = {time: row for row, time in reversed(list(enumerate(times)))}
    assert all(first[rows.values[row, 0]] == row for row in order.tolist())


def test_names_may_contain_spaces_and_lines_may_end_as_on_windows(tmp_path):
    path = tmp_path / "list.txt"
    path.write_bytes(b"\xef\xbb\xbf1.5 a b.png\r\n2.5   c.png  \r\n")
    found = read_stamped_names(path, "list.txt", [])
    assert [found.text(row) for row in range(2)] == ["a b.png", "c.png"]


def test_a_pipe_is_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "rows.txt")
    with pytest.raises(RequestError, match="pipe"):
        read_numbers(tmp_path / "rows.txt", "rows.txt", 1, [])
    with pytest.raises(RequestError, match="pipe"):
        read_matrix(tmp_path / "rows.txt", 4, 4)


def test_numbers_of_files_are_found_with_any_padding(tmp_path):
    for name in ("10.png", "0009.png", "9.png", "x.png", "1.txt", "-1.png", "9" * 30 + ".png"):
        (tmp_path / name).touch()
    files = NumberedFiles(tmp_path, re.compile(r"([0-9]+)\.png"))
    assert files.numbers.tolist() == [9, 10]
    assert (files.name(9), files.name(10), files.name(11)) == ("0009.png", "10.png", None)
    assert files.repeated == ["9.png"]
    with pytest.raises(RequestError, match="cannot be read"):
        NumberedFiles(tmp_path / "absent", re.compile("([0-9]+)"))


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("desk 1", "desk_1"), ("../x", "x"), ("a..b", "a.b"), ("", "recording"),
        ("ä" * 99, "recording"),
    ],
)  # fmt: skip
def test_trajectories_are_named_by_folders(text, name):
    assert trajectory_name(text) == name


def test_a_pose_near_on_one_side_only_is_taken_as_it_is():
    known = np.array([0.0, 0.03, 0.06])
    poses = np.array(drive(known))
    found = poses_near(np.array([-0.01, 0.005, 0.015, 0.2]), known, poses, 0.02)
    np.testing.assert_allclose(found[:2], [poses[0], poses[0]])
    np.testing.assert_allclose(found[2, :3, 3], (poses[0, :3, 3] + poses[1, :3, 3]) / 2)
    assert np.isnan(found[3]).all()


def test_poses_are_held_only_as_long_as_asked():
    known = np.array([0.0, 0.1])
    times = np.array([-0.04, -0.01, 0.0, 0.1, 0.14])
    held = poses_at(times, known, np.array(drive(known)), 0.1, max_hold=0.02)
    assert np.isfinite(held).all(axis=(1, 2)).tolist() == [False, True, True, True, False]


def turning(times: np.ndarray) -> np.ndarray:
    """A drive at 2 m/s along x that turns by 0.3 rad/s about z."""
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(np.outer(0.3 * times, [0, 0, 1])).as_matrix()
    poses[:, 0, 3] = 2 * times
    return poses


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
