"""Frames whose images and poses lie in files with a common number: 7-Scenes and ScanNet."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.tables.numeric_rows import read_matrix
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recording import RecordedTrajectory
from s2rtools.datasets.recordings.recorded_files import FrameFiles, NumberedFiles, find_file
from s2rtools.datasets.recordings.recorded_poses import orthonormal, report_unusable


@dataclass(frozen=True, slots=True)
class NumberedFrames:
    """The files of one trajectory by number.

    The folders are relative to the recording and end with `/`, or are empty.
    """

    rgb: NumberedFiles
    depth: NumberedFiles
    pose: NumberedFiles
    rgb_folder: str
    depth_folder: str
    pose_folder: str


def read_frames(
    root: Path, files: NumberedFrames, containment: PathContainment, issues: list[InputIssue]
) -> RecordedTrajectory:
    """The frames with an RGB image, a depth image and a usable pose, by number.

    Each pose file holds a matrix (4, 4) from the camera's axes to the world's, metres. Others are
    left out and reported.
    """
    frames, numbers, values = FrameFiles(root), array("q"), array("d")
    for kind, folder, listed in (
        ("image", files.rgb_folder, files.rgb),
        ("image", files.depth_folder, files.depth),
        ("pose", files.pose_folder, files.pose),
    ):
        issues += listed.repetitions(kind, folder)
    for number in files.rgb.numbers.tolist():
        rgb = f"{files.rgb_folder}{files.rgb.name(number)}"
        depth, pose = files.depth.name(number), files.pose.name(number)
        if depth is None or pose is None:
            issues.append(InputIssue("no depth image" if depth is None else "no pose", rgb))
            continue
        depth = f"{files.depth_folder}{depth}"
        found = [find_file(containment, name, str(root), issues) for name in (rgb, depth)]
        matrix = _read_pose(containment, f"{files.pose_folder}{pose}", root, issues)
        if all(found) and matrix is not None:
            frames.append(rgb, depth)
            values.extend(matrix.ravel().tolist())
            numbers.append(number)
    issues += [
        InputIssue("no RGB image", f"{files.depth_folder}{files.depth.name(number)}")
        for number in np.setdiff1d(files.depth.numbers, files.rgb.numbers).tolist()
    ]
    poses = np.asarray(values).reshape(-1, 4, 4)
    kept = np.flatnonzero(_usable(poses, files, numbers, issues))
    times = np.full(len(kept), np.nan)
    return RecordedTrajectory(frames.chosen(kept.tolist()), orthonormal(poses[kept]), times)


def _read_pose(
    containment: PathContainment, name: str, root: Path, issues: list[InputIssue]
) -> NDArray[np.float64] | None:
    path = containment.resolve(name, str(root))
    try:
        return read_matrix(path, 4, 4)
    except RequestError as error:
        issues.append(InputIssue("bad pose", name, str(error).removeprefix(f"{path}: ")))
        return None


def _usable(
    poses: NDArray[np.float64],
    files: NumberedFrames,
    numbers: Sequence[int],
    issues: list[InputIssue],
) -> NDArray[np.bool_]:
    """(N,): which poses are usable; the others are reported. One of -inf is none at all."""

    def place(row: int) -> str:
        return f"{files.pose_folder}{files.pose.name(numbers[row])}"

    lost = np.isneginf(poses).any(axis=(1, 2))
    issues += [
        InputIssue("no pose", place(row), "-inf: the recording lost its track here")
        for row in np.flatnonzero(lost).tolist()
    ]
    usable = np.zeros(len(poses), dtype=bool)
    rows = np.flatnonzero(~lost)
    usable[rows] = report_unusable(poses[rows], lambda row: place(rows[row]), issues)
    return usable
