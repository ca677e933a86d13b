"""Frames of a recording whose images lie in files, as a reader finds them row by row.

In 7-Scenes and ScanNet images and poses lie in files with a common number.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.lazy_sequence import LazySequence, RowFile, chosen
from s2rtools.common.tables.numeric_rows import read_matrix
from s2rtools.datasets.recording import (
    PinholeCamera,
    ReadOptions,
    RecordedFrame,
    RecordedTrajectory,
    Recording,
)
from s2rtools.datasets.recordings.recorded_files import ImageFile, NumberedFiles
from s2rtools.datasets.recordings.stated_cameras import CAMERA_ID, choose_camera

Floats = NDArray[np.float64]
Pattern = tuple[str, re.Pattern[str]]
"""A folder relative to the recording, with a slash at its end or empty, and the names in it."""


def matrices(values: Floats) -> Floats:
    """Poses (N, 4, 4) from rows of their elements (N, 16)."""
    return values.reshape(-1, 4, 4)


class FrameTable:
    """Rows of images, numbers of a pose, time and camera, by trajectory in recording order.

    `trajectories` are there without rows, too; the first of them, or else the only one of the
    recording, is that of rows by default. Names of images lie in a temporary file. RGB images of
    another `size` (height, width) are reported instead of read, if it is set.
    """

    def __init__(self, recording: Recording, trajectories: Sequence[str] = ()) -> None:
        self.size: tuple[int, int] | None = None
        self.recording = recording
        self._names = RowFile()
        self._values, self._times = array("d"), array("d")
        self._default = trajectories[0] if trajectories else recording.only_name
        self._trajectories = {name: array("q") for name in trajectories}
        self._cameras: dict[PinholeCamera, str] = {}
        self._used: list[str] = []

    def __len__(self) -> int:
        return len(self._names)

    def add(
        self,
        rgb: str,
        depth: str | None,
        pose: Iterable[float],
        time: float = math.nan,
        place: str = "",
        trajectory: str = "",
        camera: PinholeCamera | None = None,
    ) -> None:
        """Add a row with images relative to the recording's folder.

        `pose` are the numbers that state it, as many in every row, and `place` is where they stand,
        by default the image. The camera is given in all rows or in none.
        """
        self._trajectories.setdefault(trajectory or self._default, array("q")).append(len(self))
        self._names.append(rgb, depth, place or rgb)
        self._values.extend(pose)
        self._times.append(time)
        if camera is not None:
            self._used.append(self._cameras.setdefault(camera, str(len(self._cameras) + 1)))

    def choose_camera(self, options: ReadOptions, where: Path, default: str | None = None) -> str:
        """Set the recording's camera, leave out the rows of others, and give a remark.

        Cameras are numbered as they come. See `stated_cameras.choose_camera`. Raises RequestError
        if there are several and the option, or else `default`, chooses none, and without rows.
        """
        if not self._used:
            self.recording.require_frames()
        named = {name: camera for camera, name in self._cameras.items()}
        option = options.values.get(CAMERA_ID, default)
        self.recording.camera, kept, remark = choose_camera(named, self._used, option, where)
        for name, rows in self._trajectories.items():
            of_camera = (row for row in rows if self._used[row] in kept)
            self._trajectories[name] = array("q", of_camera)
        return remark

    def fill(self, to_poses: Callable[[Floats], Floats] = matrices) -> None:
        """Give the recording its trajectories.

        `to_poses` makes poses (N, 4, 4) of the camera in the world, metres, from rows of numbers.
        """
        if not len(self):
            self._trajectories.setdefault(self._default, array("q"))
        values = np.asarray(self._values)
        poses = to_poses(values.reshape(len(self), -1)) if len(self) else np.empty((0, 4, 4))
        frames, times = LazySequence(len(self), self._frame), np.asarray(self._times)
        for name, rows in self._trajectories.items():
            kept = np.asarray(rows, dtype=np.intp)
            self.recording.trajectories[name] = RecordedTrajectory(
                chosen(frames, rows), poses[kept], times[kept], self._places(rows)
            )

    def _places(self, rows: array[int]) -> Callable[[int], str]:
        return lambda row: str(self._names[rows[row]][2])

    def _frame(self, number: int) -> RecordedFrame:
        rgb, depth, _ = self._names[number]
        root = self.recording.root
        return RecordedFrame(
            ImageFile(root / rgb, rgb, self.size),
            None if depth is None else ImageFile(root / depth, depth, is_depth=True),
        )


def read_frames(
    recording: Recording, patterns: Mapping[str, Pattern], trajectory: str = ""
) -> None:
    """Add a trajectory, by default the only one, of numbered images with a depth and a pose file.

    Images without these files are reported.
    `patterns` are those of `rgb`, `depth` and `pose`; without `depth`, only colour images are read.
    Each pose file holds a matrix (4, 4) from the camera's axes to the world's, metres. Raises
    RequestError if a folder is missing.
    """
    listed = {
        kind: NumberedFiles(recording.root / folder, pattern)
        for kind, (folder, pattern) in patterns.items()
    }

    def path(kind: str, number: int) -> str:
        return f"{patterns[kind][0]}{listed[kind].name(number)}"

    for kind, files in listed.items():
        what = "pose" if kind == "pose" else "image"
        for name in files.repeated:
            file = f"{patterns[kind][0]}{name}"
            recording.report(f"repeated {what}", file, "another file has its number")
    images = [kind for kind in ("rgb", "depth") if kind in listed]
    table = FrameTable(recording, [trajectory] if trajectory else ())
    for number in listed["rgb"].numbers.tolist():
        if any(listed[kind].name(number) is None for kind in images):
            recording.report("no depth image", path("rgb", number))
        elif listed["pose"].name(number) is None:
            recording.report("no pose", path("rgb", number))
        else:
            names = [path(kind, number) for kind in images]
            found = [recording.has_image(name) for name in names]
            matrix = _read_pose(recording, path("pose", number))
            if all(found) and matrix is not None:
                depth = names[1] if len(names) > 1 else None
                table.add(names[0], depth, matrix.ravel(), place=path("pose", number))
    if "depth" in listed:
        for number in np.setdiff1d(listed["depth"].numbers, listed["rgb"].numbers).tolist():
            recording.report("no RGB image", path("depth", number))
    table.fill()


def _read_pose(recording: Recording, name: str) -> NDArray[np.float64] | None:
    path = recording.resolve(name)
    try:
        return read_matrix(path, 4, 4)
    except RequestError as error:
        recording.report("bad pose", name, str(error).removeprefix(f"{path}: "))
        return None
