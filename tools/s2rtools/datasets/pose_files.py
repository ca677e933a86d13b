"""Frames whose images and poses lie in files with a common number: 7-Scenes and ScanNet."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.datasets.numeric_rows import read_matrix
from s2rtools.datasets.path_containment import PathContainment
from s2rtools.datasets.recorded_files import FrameFiles, NumberedFiles, find_file
from s2rtools.datasets.recorded_poses import orthonormal, pose_defect, usable_poses
from s2rtools.datasets.recording import RecordedTrajectory
from s2rtools.datasets.scan import InputIssue


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
    frames, numbers, poses = FrameFiles(root), array("q"), array("d")
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
        depth, pose = f"{files.depth_folder}{depth}", f"{files.pose_folder}{pose}"
        found = [find_file(containment, each, str(root), issues) for each in (rgb, depth)]
        if not all(found):
            continue
        matrix = _read_pose(containment, pose, root, issues)
        if matrix is not None:
            frames.append(rgb, depth)
            poses.extend(matrix.ravel().tolist())
            numbers.append(number)
    _report_without_rgb(files, issues)
    count = len(frames)
    return RecordedTrajectory(
        frames.chosen(range(count)),
        orthonormal(np.asarray(poses).reshape(-1, 4, 4)),
        np.full(count, np.nan),
    )


def _read_pose(
    containment: PathContainment, name: str, root: Path, issues: list[InputIssue]
) -> NDArray[np.float64] | None:
    path = containment.resolve(name, str(root))
    try:
        pose = read_matrix(path, 4, 4)
    except RequestError as error:
        issues.append(InputIssue("bad pose", name, str(error).removeprefix(f"{path}: ")))
        return None
    if usable_poses(pose[None])[0]:
        return pose
    if np.isneginf(pose).any():
        issues.append(InputIssue("no pose", name, "-inf: the recording lost its track here"))
    else:
        issues.append(InputIssue("bad pose", name, pose_defect(pose)))
    return None


def _report_without_rgb(files: NumberedFrames, issues: list[InputIssue]) -> None:
    for number in np.setdiff1d(files.depth.numbers, files.rgb.numbers).tolist():
        name = f"{files.depth_folder}{files.depth.name(number)}"
        issues.append(InputIssue("no RGB image", name))
