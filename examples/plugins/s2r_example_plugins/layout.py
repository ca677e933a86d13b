"""Layout `xyh`: `walk.csv` with columns file, x, y, heading (metres, radians) beside its images.

The camera looks ahead, 1 m above the floor; its focal length is half the width of the images. Rows
are a second apart.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from s2rtools.common.tables.csv_rows import parse_float, read_rows
from s2rtools.datasets.recording import Layout, PinholeCamera, ReadOptions, Recording
from s2rtools.datasets.recordings.frame_table import FrameTable, matrices
from s2rtools.datasets.recordings.stated_cameras import image_size


def read(path: Path, options: ReadOptions) -> Recording:
    """Read a folder with `walk.csv`."""
    recording = Recording.of_folder("xyh", path, options)
    table = FrameTable(recording)
    for number, row in read_rows(path / "walk.csv", ("file", "x", "y", "heading")):
        x, y, heading = (parse_float(row[name]) for name in ("x", "y", "heading"))
        cos, sin = np.cos(heading), np.sin(heading)
        pose = (sin, 0, cos, x, -cos, 0, sin, y, 0, -1, 0, 1.0, 0, 0, 0, 1)
        table.add(row["file"], None, pose, float(number))
    table.fill(matrices)
    height, width = image_size(recording)
    recording.camera = PinholeCamera(width, height, width / 2, width / 2, width / 2, height / 2)
    recording.up = (0.0, 0.0, 1.0)
    return recording


LAYOUT = Layout(read, "walk.csv with places and headings beside its images")
