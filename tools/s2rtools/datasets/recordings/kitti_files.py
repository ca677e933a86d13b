"""Read a sequence of KITTI odometry: its images, `times.txt`, `poses/NN.txt` and `calib.txt`."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.common.tables.numeric_rows import NumericRows, read_numbers
from s2rtools.common.tables.text_lines import read_lines
from s2rtools.datasets.recording import Recording
from s2rtools.datasets.recordings.frame_table import FrameTable
from s2rtools.datasets.recordings.recorded_files import NumberedFiles
from s2rtools.datasets.recordings.recorded_poses import orthonormal, usable_poses

_IMAGE = re.compile(r"([0-9]+)\.(?:png|jpg)", re.IGNORECASE)


def read_projection(recording: Recording, name: str, key: str) -> tuple[NDArray[np.float64], str]:
    """The matrix (3, 4) of a key in `calib.txt`, and its place."""
    path = recording.resolve(name)
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
        return matrix, f"{path}"
    raise RequestError(f"{path}: no line {key}:")


def add_frames(
    recording: Recording, name: str, camera: str, projection: NDArray[np.float64]
) -> None:
    """Add the images of a camera that have a pose and a time as trajectory `name`."""
    folder = f"sequences/{name}/image_{camera}/"
    listed = NumberedFiles(recording.resolve(folder), _IMAGE)
    for repeated in listed.repeated:
        recording.report("repeated image", folder + repeated, "another file has its number")
    times = _read_rows(recording, f"sequences/{name}/times.txt", 1)
    poses = _read_rows(recording, f"poses/{name}.txt", 12)
    table = FrameTable(recording, [name])
    for number in listed.numbers.tolist():
        file = f"{folder}{listed.name(number)}"
        for kind, rows in (("no pose", poses), ("no time", times)):
            if number >= len(rows.values) or not np.isfinite(rows.values[number]).any():
                recording.report(kind, file, f"row {number + 1} of {rows.name}")
                break
        else:
            if recording.has_image(file):
                place, time = poses.place(number), times.values[number, 0]
                table.add(file, None, poses.values[number], time, place)
    count = max(len(times.values), len(poses.values))
    for number in np.setdiff1d(np.arange(count), listed.numbers).tolist():
        detail = f"row {number + 1} of {poses.name} or {times.name}"
        recording.report("missing image", f"{folder}{number:06d}.png", detail)
    offset = np.eye(4)
    offset[:3, 3] = -np.linalg.solve(projection[:, :3], projection[:, 3])

    def to_poses(values: NDArray[np.float64]) -> NDArray[np.float64]:
        matrices = np.tile(np.eye(4), (len(values), 1, 1))
        matrices[:, :3] = values.reshape(-1, 3, 4)
        usable = usable_poses(matrices)
        matrices[usable] = orthonormal(matrices[usable]) @ offset
        return matrices

    table.fill(to_poses)


def _read_rows(recording: Recording, name: str, columns: int) -> NumericRows:
    """The rows of a file, one for each image; NaN for those that cannot be read."""
    return read_numbers(recording.resolve(name), name, columns, recording.issues, keep_bad=True)
