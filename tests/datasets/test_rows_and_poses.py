import os
import re
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

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
from s2rtools.datasets.recordings.recorded_poses import poses_at, poses_near
from tests.datasets.layouts.recordings import drive


@given(st.lists(st.tuples(*[st.floats(allow_nan=False)] * 3), min_size=1, max_size=20))
def test_numbers_are_read_exactly(rows):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rows.txt"
        path.write_text("\n".join(" ".join(map(repr, row)) for row in rows))
        issues: list[InputIssue] = []
        found = read_numbers(path, "rows.txt", 3, issues)
        np.testing.assert_array_equal(found.values, np.array(rows))
        assert found.place(len(rows) - 1) == f"rows.txt:{len(rows)}"
        assert issues == []


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


def test_bad_rows_are_kept_as_nan_on_request(tmp_path):
    path = tmp_path / "rows.txt"
    path.write_text("# comment\n1 2\n\n3 x\n5 6\n")
    issues: list[InputIssue] = []
    found = read_numbers(path, "rows.txt", 2, issues, keep_bad=True)
    np.testing.assert_array_equal(found.values, [[1, 2], [np.nan, np.nan], [5, 6]])
    assert [issue.file for issue in issues] == ["rows.txt:4"]
    assert len(read_numbers(path, "rows.txt", 2, []).values) == 2


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
