"""Checks that all log readers share, and the construction of a log from its rows."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.input_files import open_regular
from s2rstore.geometry import angles
from s2rtools.motion_logs.motion_log import Floats, Log

LONGEST_PAUSE = 600.0
"""Longest time between two poses of one drive, s."""
FARTHEST = 1e9
"""Largest coordinate in m, and heading in rad."""
HIGHEST, STEEPEST = 0.2, 0.2
"""Metres that z may span, and its share of what x and y span, in poses on a floor."""
Place = Callable[[int], str]
"""Position of row i in the source, such as `drive.csv:12`."""


def digest(path: Path) -> str:
    """SHA-256 of a file, or of a folder's files by name."""
    files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
    sha256 = hashlib.sha256()
    for file in files:
        if file != path:
            sha256.update(file.relative_to(path).as_posix().encode() + b"\0")
        with open_regular(file) as stream:
            while block := stream.read(1 << 20):
                sha256.update(block)
    return sha256.hexdigest()


def numbers(texts: Sequence[str], names: Sequence[str], place: str) -> list[float]:
    """The texts of one row as finite numbers."""
    values = []
    for text, name in zip(texts, names, strict=True):
        try:
            value = float(text)
        except ValueError:
            shown = text.strip() or "empty"
            raise RequestError(f"{place}: {name} is {shown}, not a number") from None
        if not np.isfinite(value):
            raise RequestError(f"{place}: {name} is {text.strip()}; remove the row")
        values.append(value)
    return values


def check_clock(time: Floats, place: Place) -> None:
    """Raises RequestError at the first row whose time is not later than the one before."""
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        i = int(late[0]) + 1
        fault = "stands still" if time[i] == time[i - 1] else "runs backward"
        raise RequestError(
            f"{place(i)}: the clock {fault} ({time[i - 1]:.9g} s, then {time[i]:.9g} s)"
        )


def check_pace(time: Floats, place: Place) -> None:
    """Raises RequestError for a pause that suggests other units, or a clock that was reset."""
    steps = np.diff(time)
    paused = np.flatnonzero(steps > LONGEST_PAUSE)
    if paused.size:
        i = int(paused[0])
        raise RequestError(
            f"{place(i + 1)}: {steps[i]:.6g} s after the pose before it; are the times in seconds? "
            "Else split the log there, or leave out what was recorded before the clock was set"
        )


def check_floor(positions: NDArray[np.float64], path: Path) -> tuple[str, ...]:
    """Warnings about `positions` (n, 3), m, of which a log keeps x and y alone.

    Raises RequestError where z varies as it does only if it is not the axis against gravity.
    """
    with np.errstate(over="ignore"):
        span = np.ptp(positions, axis=0)
        across = float(np.hypot(span[0], span[1]))
    if span[2] <= HIGHEST:
        return ()
    found = f"{path}: z spans {span[2]:.3g} m where x and y span {across:.3g} m"
    if span[2] <= STEEPEST * across:
        return (f"{found}; z is left out, and slopes count by their length on the map",)
    raise RequestError(
        f"{found}; z must point up and the robot stay on a floor, because z is left out: turn the "
        "poses, or write x, y and heading as CSV"
    )


def log(
    poses: NDArray[np.float64], path: Path, place: Place, warnings: tuple[str, ...] = ()
) -> Log:
    """A log from finite `poses` (n, 4): time, x, y, heading in rad, which is wrapped."""
    if len(poses) < 2:
        raise RequestError(f"{path}: {len(poses)} poses; a log needs at least 2")
    check_clock(poses[:, 0], place)
    check_pace(poses[:, 0], place)
    far = np.flatnonzero((np.abs(poses[:, 1:]) > FARTHEST).any(axis=1))
    if far.size:
        raise RequestError(f"{place(int(far[0]))}: a pose beyond {FARTHEST:g} m or rad; remove it")
    time, x, y, heading = (np.ascontiguousarray(column) for column in poses.T)
    warnings += tuple(
        f"{place(i)}: heading {heading[i]:.6g} rad is over a whole turn; if these are degrees, "
        "name the column heading_deg"
        for i in np.flatnonzero(np.abs(heading) > 2 * np.pi * (1 + 1e-6))[:1].tolist()
    )
    return Log(time, x, y, angles.wrap(heading), str(path), digest(path), warnings)
