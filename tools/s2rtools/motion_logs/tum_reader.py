"""Motion logs in TUM format: lines `time tx ty tz qx qy qz qw`.

The heading is the yaw. z points up and is left out; poses that do not stay on a floor are refused.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.tables.numeric_rows import POSE_COLUMNS, read_numbers
from s2rtools.motion_logs import row_checks
from s2rtools.motion_logs.motion_log import Log


def read(path: Path) -> Log:
    """Read a log. Raises RequestError with the line number for an invalid file."""
    issues: list[InputIssue] = []
    rows = read_numbers(path, str(path), len(POSE_COLUMNS), issues)
    if issues:
        columns = " ".join(POSE_COLUMNS)
        raise RequestError(f"{issues[0].file}: {issues[0].detail}; a line has {columns}")
    for row, column in np.argwhere(~np.isfinite(rows.values))[:1].tolist():
        value = rows.values[row, column]
        raise RequestError(f"{rows.place(row)}: {POSE_COLUMNS[column]} is {value}; remove the row")
    heading = yaw(rows.values[:, 4:8], rows.place)
    poses = np.column_stack([rows.values[:, :3], heading])
    warnings = row_checks.check_floor(rows.values[:, 1:4], path)
    return row_checks.log(poses, path, rows.place, warnings)


def yaw(quaternions: NDArray[np.float64], place: row_checks.Place) -> NDArray[np.float64]:
    """Yaw (n,), rad, of quaternions (n, 4) x, y, z, w, which need not be normalised."""
    length = np.linalg.norm(quaternions, axis=1)
    zero = np.flatnonzero(length < 1e-9)
    if zero.size:
        raise RequestError(f"{place(int(zero[0]))}: the quaternion is 0; there is no heading")
    x, y, z, w = (quaternions / length[:, None]).T
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
