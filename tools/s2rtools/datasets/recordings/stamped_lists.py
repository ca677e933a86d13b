"""Lists of images and of poses with their times, and what belongs together in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rtools.common.tables.numeric_rows import (
    NumericRows,
    in_time_order,
    read_numbers,
    read_stamped_names,
)
from s2rtools.datasets.recording import Recording
from s2rtools.datasets.recordings.recorded_poses import (
    nearest_times,
    poses_from_quaternions,
    report_unusable,
)


@dataclass(frozen=True, slots=True, eq=False)
class ImageList:
    """Images that exist, by ascending `times` (N,), seconds."""

    times: NDArray[np.float64]
    _rows: NumericRows
    _order: NDArray[np.intp]
    _folder: str

    def name(self, number: int) -> str:
        """The path of an image relative to the recording."""
        return self._folder + self._rows.text(int(self._order[number]))


def read_image_list(
    recording: Recording,
    name: str,
    folder: str = "",
    separator: str | None = None,
    per_second: float = 1.0,
) -> ImageList:
    """Read a list of times and names of images; those that do not exist are reported.

    `folder`, with a slash at its end, is put before each name. A second has `per_second` units of
    the times.
    """
    rows = read_stamped_names(recording.resolve(name), name, recording.issues, separator)
    order = in_time_order(rows, recording.issues)
    found = [
        recording.has_image(folder + rows.text(row), f"{recording.root / rows.place(row)}")
        for row in order.tolist()
    ]
    order = order[np.asarray(found, dtype=bool)]
    return ImageList(rows.values[order, 0] / per_second, rows, order, folder)


@dataclass(frozen=True, slots=True, eq=False)
class PoseList:
    """Usable poses (K, 4, 4) by ascending `times` (K,), seconds."""

    times: NDArray[np.float64]
    poses: NDArray[np.float64]


def read_pose_list(
    recording: Recording,
    name: str,
    quaternion: tuple[int, int, int, int] = (4, 5, 6, 7),
    separator: str | None = None,
    per_second: float = 1.0,
    more: bool = False,
) -> PoseList:
    """Read a list of times, positions in metres and quaternions; unusable rows are reported.

    `quaternion` are the columns of x, y, z and w, those of time and position are the first four. A
    second has `per_second` units of the times. With `more` further columns are ignored.
    """
    path, issues = recording.resolve(name), recording.issues
    rows = read_numbers(path, name, 8, issues, separator, more)
    poses = poses_from_quaternions(rows.values[:, 1:4], rows.values[:, quaternion])
    usable = np.flatnonzero(report_unusable(poses, rows.place, issues))
    rows, poses = rows.chosen(usable), poses[usable]
    order = in_time_order(rows, issues)
    return PoseList(rows.values[order, 0] / per_second, poses[order])


def report_none_near(
    recording: Recording,
    kind: str,
    images: list[tuple[str, float]],
    known_times: NDArray[np.float64],
    rule: str,
) -> None:
    """Report `images`, names and times in seconds, that have no pose or depth image.

    `known_times` (K,) are those of all poses or depth images, ascending. `rule` is what none of
    them fulfils.
    """
    times = np.array([time for _, time in images], dtype=np.float64)
    rows = nearest_times(times, known_times, np.inf)
    for (name, time), row in zip(images, rows.tolist(), strict=True):
        near = f"; the nearest is {abs(time - known_times[row]):.3f} s away" if row >= 0 else ""
        recording.report(kind, name, rule + near)
