"""Motion logs in TUM format: lines `time tx ty tz qx qy qz qw`.

The heading is the yaw. z points up and is left out; poses that do not stay on a floor are refused.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.motion_logs import row_checks
from s2rtools.motion_logs.motion_log import Log

_COLUMNS = ("time", "tx", "ty", "tz", "qx", "qy", "qz", "qw")


def read(path: Path) -> Log:
    """Read a log. Raises RequestError with the line number for an invalid file."""
    lines: list[int] = []
    rows: list[list[float]] = []
    for number, line in enumerate(row_checks.text_of(path).splitlines(), start=1):
        values = line.split()
        if not values or values[0].startswith("#"):
            continue
        if len(values) != len(_COLUMNS):
            raise RequestError(
                f"{path}:{number}: {len(values)} values; TUM has 8: {' '.join(_COLUMNS)}"
            )
        rows.append(row_checks.numbers(values, _COLUMNS, f"{path}:{number}"))
        lines.append(number)
    if not rows:
        raise RequestError(f"{path}: no poses, only comments")
    table = np.array(rows)
    heading = yaw(table[:, 4:8], lambda i: f"{path}:{lines[i]}")
    poses = np.column_stack([table[:, :3], heading])
    warnings = row_checks.check_floor(table[:, 1:4], path)
    return row_checks.log(poses, path, lambda i: f"{path}:{lines[i]}", warnings)


def yaw(quaternions: NDArray[np.float64], place: row_checks.Place) -> NDArray[np.float64]:
    """Yaw (n,), rad, of quaternions (n, 4) x, y, z, w, which need not be normalised."""
    length = np.linalg.norm(quaternions, axis=1)
    zero = np.flatnonzero(length < 1e-9)
    if zero.size:
        raise RequestError(f"{place(int(zero[0]))}: the quaternion is 0; there is no heading")
    x, y, z, w = (quaternions / length[:, None]).T
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
