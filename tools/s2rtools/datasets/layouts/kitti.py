"""KITTI odometry: `sequences/NN/{calib.txt,times.txt,image_0..image_3}` and `poses/NN.txt`.

A line of `poses/NN.txt` is the 3x4 matrix from the axes of camera 0 (x right, y down, z forward) at
that image to those at the first image, metres. `P0` to `P3` in `calib.txt` are the projections of
the rectified cameras 0 to 3 from the axes of camera 0: camera i lies at -K^-1 p in them, K the left
3x3 part and p the last column. Images are rectified; 0 and 1 are grey, 2 and 3 are in colour. There
is no depth. The world's up is -y of the first image, whose camera is mounted level: a slope of the
road there tilts it.

The calibration was published with OpenCV's rectification, so the centre of the first pixel is taken
as 0; the data set does not state it.
"""

from __future__ import annotations

import math
import re
from array import array
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.tables.numeric_rows import NumericRows, read_numbers
from s2rtools.common.tables.text_lines import read_lines
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recording import (
    Layout,
    PinholeCamera,
    ReadOptions,
    RecordedTrajectory,
    Recording,
)
from s2rtools.datasets.recordings.recorded_files import (
    FrameFiles,
    NumberedFiles,
    commonest_size,
    find_file,
)
from s2rtools.datasets.recordings.recorded_folders import (
    existing_folder,
    folder_name,
    require_frames,
)
from s2rtools.datasets.recordings.recorded_poses import orthonormal, report_unusable
from s2rtools.datasets.recordings.stated_cameras import checked, opencv_camera
from s2rtools.datasets.scan import choose_trajectories

_SEQUENCE = re.compile(r"[0-9]{2,4}")
_IMAGE = re.compile(r"([0-9]+)\.(?:png|jpg)", re.IGNORECASE)
_CAMERAS = ("2", "0", "1", "3")
"""In order of preference: colour before grey, left before right."""


@dataclass(frozen=True, slots=True, eq=False)
class _Sequence:
    """One sequence: its frames, and its camera for images of their size."""

    trajectory: RecordedTrajectory
    camera: PinholeCamera


def read(path: Path, options: ReadOptions) -> Recording:
    """Read the data set's folder, or one folder `sequences/NN`.

    Raises RequestError if files are missing or unusable, and if sequences have several cameras.
    """
    folder = existing_folder(path)
    known = _sequences(folder)
    if not known:
        whole = path.resolve()
        if whole.parent.name != "sequences" or not (whole / "calib.txt").is_file():
            raise RequestError(f"{path}: neither sequences/NN nor calib.txt in it")
        folder, known = whole.parent.parent, [whole.name]
    containment = PathContainment(folder, options.allow_outside)
    posed = [name for name in known if (folder / "poses" / f"{name}.txt").is_file()]
    if not posed:
        raise RequestError(f"{folder / 'poses' / f'{known[0]}.txt'}: missing; no poses to read")
    chosen = choose_trajectories(options.trajectories, posed, path)
    issues = [
        InputIssue("no poses", f"sequences/{name}", f"no poses/{name}.txt")
        for name in sorted(set(known) - set(posed))
    ]
    camera = options.values.get("camera") or _first_camera(folder / "sequences" / chosen[0])
    if camera not in _CAMERAS:
        raise RequestError(f"option camera={camera}: choose from {', '.join(sorted(_CAMERAS))}")
    sequences = {}
    for name in chosen:
        sequence = _read_sequence(folder, name, camera, containment, issues)
        if sequence is None:
            issues.append(InputIssue("empty trajectory", name, "no usable image"))
        else:
            sequences[name] = sequence
    trajectories = {name: each.trajectory for name, each in sequences.items()}
    require_frames("kitti", folder, trajectories, issues)
    return Recording(
        layout="kitti",
        name=folder_name(path),
        root=folder,
        camera=_common_camera(sequences, folder),
        up=(0.0, -1.0, 0.0),
        has_own_worlds=True,
        trajectories=trajectories,
        issues=issues,
        provenance={"camera": f"image_{camera}"},
        outside_folders=containment.outside_folders,
    )


def _sequences(folder: Path) -> list[str]:
    if not (folder / "sequences").is_dir():
        return []
    found = (each for each in (folder / "sequences").iterdir() if each.is_dir())
    return sorted(each.name for each in found if _SEQUENCE.fullmatch(each.name))


def _first_camera(folder: Path) -> str:
    for camera in _CAMERAS:
        if (folder / f"image_{camera}").is_dir():
            return camera
    raise RequestError(f"{folder}: no folder image_0, image_1, image_2 or image_3")


def _common_camera(sequences: dict[str, _Sequence], folder: Path) -> PinholeCamera:
    """The camera of all sequences. Raises RequestError if they have several."""
    first_name, first = next(iter(sequences.items()))
    for name, sequence in sequences.items():
        if sequence.camera != first.camera:
            raise RequestError(
                f"{folder}: the cameras of sequences {first_name} and {name} differ; read one, "
                f"such as {folder / 'sequences' / first_name}"
            )
    return first.camera


def _read_sequence(
    folder: Path, name: str, camera: str, containment: PathContainment, issues: list[InputIssue]
) -> _Sequence | None:
    """The images of a camera that have a pose and a time; None if there is none."""
    calibration = f"sequences/{name}/calib.txt"
    projection = _projection(folder, calibration, f"P{camera}", containment)
    trajectory = _read_trajectory(folder, name, camera, containment, issues)
    if not len(trajectory.frames):
        return None
    matrix = projection[:, :3]
    offset = np.eye(4)
    offset[:3, 3] = -np.linalg.solve(matrix, projection[:, 3])
    intrinsics = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    fx, fy, cx, cy = (float(value) for value in intrinsics)
    pinhole = opencv_camera(commonest_size(trajectory.frames, folder), (fx, fy, cx, cy))
    placed = replace(trajectory, poses=trajectory.poses @ offset)
    return _Sequence(placed, checked(pinhole, str(folder / calibration)))


def _read_trajectory(
    folder: Path, name: str, camera: str, containment: PathContainment, issues: list[InputIssue]
) -> RecordedTrajectory:
    """The images of a camera that have a pose and a time, with the poses of camera 0."""
    images = f"sequences/{name}/image_{camera}"
    listed = NumberedFiles(containment.resolve(images, str(folder)), _IMAGE)
    issues += listed.repetitions("image", f"{images}/")
    times = _rows(folder, f"sequences/{name}/times.txt", 1, containment, issues)
    rows = _rows(folder, f"poses/{name}.txt", 12, containment, issues)
    poses, stated, usable = _poses(rows, issues)
    files, kept, kept_times = FrameFiles(folder), array("q"), array("d")
    for number in listed.numbers.tolist():
        file = f"{images}/{listed.name(number)}"
        time = float(times.values[number, 0]) if number < len(times.values) else math.nan
        if number >= len(poses) or not stated[number]:
            issues.append(InputIssue("no pose", file, f"row {number + 1} of {rows.name}"))
        elif not math.isfinite(time):
            issues.append(InputIssue("no time", file, f"row {number + 1} of {times.name}"))
        elif usable[number] and find_file(containment, file, str(folder), issues):
            files.append(file)
            kept.append(number)
            kept_times.append(time)
    count = max(len(times.values), len(poses))
    for number in np.setdiff1d(np.arange(count), listed.numbers).tolist():
        detail = f"row {number + 1} of {rows.name} or {times.name}"
        issues.append(InputIssue("missing image", f"{images}/{number:06d}.png", detail))
    trajectory = RecordedTrajectory(
        files.chosen(range(len(files))),
        orthonormal(poses[np.asarray(kept, dtype=np.intp)]),
        np.asarray(kept_times),
    )
    _report_times_not_in_order(trajectory, times.name, issues)
    return trajectory


def _poses(
    rows: NumericRows, issues: list[InputIssue]
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    """Poses (N, 4, 4), and which are stated and usable; unusable ones are reported."""
    poses = np.tile(np.eye(4), (len(rows.values), 1, 1))
    poses[:, :3] = rows.values.reshape(-1, 3, 4)
    stated = np.asarray(~np.isnan(rows.values).all(axis=1))
    usable = np.zeros(len(poses), dtype=bool)
    numbers = np.flatnonzero(stated)
    usable[numbers] = report_unusable(
        poses[numbers], lambda row: rows.place(int(numbers[row])), issues
    )
    return poses, stated, usable


def _rows(
    folder: Path, name: str, columns: int, containment: PathContainment, issues: list[InputIssue]
) -> NumericRows:
    """The rows of a file, one for each image; NaN for those that cannot be read."""
    path = containment.resolve(name, str(folder))
    return read_numbers(path, name, columns, issues, keep_bad=True)


def _report_times_not_in_order(
    trajectory: RecordedTrajectory, name: str, issues: list[InputIssue]
) -> None:
    steps = np.diff(trajectory.timestamps)
    if (steps <= 0).any():
        detail = f"{int((steps <= 0).sum())} times are not later than the one before them; kept"
        issues.append(InputIssue("times not in order", name, detail))


def _projection(
    folder: Path, name: str, key: str, containment: PathContainment
) -> NDArray[np.float64]:
    """The matrix (3, 4) of a key in `calib.txt`."""
    path = containment.resolve(name, str(folder))
    for number, line in read_lines(path):
        label, _, text = line.partition(":")
        if label.strip() != key:
            continue
        try:
            values = np.array([float(field) for field in text.split()])
        except ValueError as error:
            raise RequestError(f"{path}:{number}: {error}") from error
        if len(values) != 12 or not np.isfinite(values).all():
            raise RequestError(f"{path}:{number}: {key} needs 12 finite numbers")
        matrix = values.reshape(3, 4)
        lower = np.abs(matrix[[1, 2, 2], [0, 0, 1]]).max()
        if lower > 1e-6 or abs(matrix[2, 2] - 1) > 1e-6 or matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
            raise RequestError(f"{path}:{number}: {key} is no projection of a rectified camera")
        return matrix
    raise RequestError(f"{path}: no line {key}:")


LAYOUT = Layout(
    read,
    "KITTI odometry: sequences/NN and poses/NN.txt",
    {"camera": "0 to 3: the images in image_N (default: 2, else 0)"},
)
