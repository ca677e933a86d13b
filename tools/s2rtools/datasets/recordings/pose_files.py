"""Frames whose images and poses lie in files with a common number: 7-Scenes and ScanNet."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.common.tables.numeric_rows import read_matrix
from s2rtools.datasets.recording import WITHOUT_DEPTH, Recording
from s2rtools.datasets.recordings.frame_table import FrameTable
from s2rtools.datasets.recordings.recorded_files import NumberedFiles

Pattern = tuple[str, re.Pattern[str]]
"""A folder relative to the recording, with a slash at its end or empty, and the names in it."""


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
    advice = WITHOUT_DEPTH if any(not len(listed[kind]) for kind in images) else ""
    table = FrameTable(recording, [trajectory] if trajectory else ())
    for number in listed["rgb"].numbers.tolist():
        if any(listed[kind].name(number) is None for kind in images):
            recording.report("no depth image", path("rgb", number), advice)
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
