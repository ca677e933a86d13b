"""One side of a data set as a CSV file: images and poses of anybody's recording.

    rgb,depth,x,y,z,qx,qy,qz,qw[,timestamp][,trajectory]       6-DoF poses, or
    rgb,depth,x,y,heading[,timestamp][,trajectory]             poses on the floor

`rgb` and `depth` are files relative to the CSV file and inside its folder; the column `depth` may
be left out or empty in all rows. x, y and z in metres, time in seconds. Quaternions turn the
camera's axes into the world's. Headings are in degrees, anticlockwise as seen from above with 0
along x: forward is (cos, sin), up is z. Rows are in recording order.

The TOML or JSON file with the CSV file's name, or the file of option `camera`, describes the
camera: see `camera_description`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from s2rstore.errors import RequestError
from s2rtools.common.tables.csv_rows import parse_float, read_rows
from s2rtools.datasets.recording import (
    DEPTH_OPTION,
    Layout,
    ReadOptions,
    Recording,
    trajectory_name,
)
from s2rtools.datasets.recordings.camera_description import (
    POSE_COLUMNS,
    CameraDescription,
    describe_cameras,
    needed_columns,
)
from s2rtools.datasets.recordings.frame_table import FrameTable

_COLUMNS = ("rgb", "depth", *POSE_COLUMNS, "timestamp", "trajectory")
_OF_MANIFEST = "domain"
"""A column that only the manifest of `s2r ingest csv` has."""


def read(path: Path, options: ReadOptions) -> Recording:
    """Read a CSV file and the description of its camera.

    Raises RequestError if one of them is missing or malformed.
    """
    if not path.is_file():
        reason = "no regular file" if path.exists() else "no such file"
        reason = "a folder; name the CSV file in it" if path.is_dir() else reason
        raise RequestError(f"{path}: {reason}")
    name = trajectory_name(path.stem)
    recording = Recording("csv", name, path.parent, allow_outside=options.allow_outside)
    description = describe_cameras(recording, options.values.get("camera"), path)
    read_columns = [name for name in _COLUMNS if name != "depth" or options.reads_depth]
    _add_rows(recording, path, description, read_columns)
    return recording


def _add_rows(
    recording: Recording, path: Path, description: CameraDescription, read_columns: Sequence[str]
) -> None:
    """Add the rows whose images exist, by trajectory, in order of their lines."""
    table = FrameTable(recording)
    columns: list[str] = []
    has_depth: bool | None = None

    def check(names: Collection[str]) -> None:
        if _OF_MANIFEST in names:
            raise RequestError(
                f"{path}: a manifest of both sides (column {_OF_MANIFEST}), which `s2r ingest csv` "
                "reads; layout csv takes a file for each side"
            )
        columns.extend(needed_columns(path, names, "rgb")[1:])

    for line, row in read_rows(path, read_columns, check):
        if has_depth is None:
            has_depth = bool(row.get("depth"))
        depth, place = row.get("depth", ""), f"{path.name}:{line}"
        if depth and not has_depth:
            advice = "give depth in all rows or in none"
            raise RequestError(f"{path}:{line}: a depth image, but none in the first row; {advice}")
        if not row["rgb"] or (has_depth and not depth):
            recording.report("incomplete row", place, f"no {'depth' if row['rgb'] else 'rgb'}")
            continue
        images = {"image": row["rgb"]} | ({"depth image": depth} if has_depth else {})
        found = [recording.has_image(name, f"{path}:{line}", what) for what, name in images.items()]
        if all(found):
            table.add(
                row["rgb"],
                depth if has_depth else None,
                [parse_float(row[column]) for column in columns],
                parse_float(row.get("timestamp")),
                place,
                row.get("trajectory") or "",
            )
    if has_depth is None:
        raise RequestError(f"{path}: no rows; the first line names {', '.join(_COLUMNS)}")
    table.fill(description.poses)


LAYOUT = Layout(
    read,
    "CSV file of images and poses, with a TOML file that describes the camera",
    {
        "camera": "TOML or JSON file that describes the camera (default: that beside the CSV file)",
        "depth": DEPTH_OPTION,
    },
)
