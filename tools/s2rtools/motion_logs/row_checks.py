"""What every reader demands of rows before they are a log."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.input_files import open_regular, read_text
from s2rstore.geometry import angles
from s2rtools.motion_logs.motion_log import Floats, Log

LONGEST_PAUSE = 600.0
"""s between two poses of one drive."""
FARTHEST = 1e9
"""m, and rad"""
MOST_TEXT = 64 << 20
"""Maximum size of a text log in bytes; holds about half a million poses."""
Place = Callable[[int], str]
"""Where in the source row i stands, as `drive.csv:12`."""


def text_of(path: Path) -> str:
    """The whole file; raises RequestError where it is missing, no text or empty."""
    text = read_text(path, MOST_TEXT)
    if not text.strip():
        raise RequestError(f"{path}: empty")
    return text


def digest(path: Path) -> str:
    """SHA-256 of a file, or of a folder's files by name."""
    files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
    found = hashlib.sha256()
    for file in files:
        if file != path:
            found.update(file.relative_to(path).as_posix().encode() + b"\0")
        with open_regular(file) as opened:
            while block := opened.read(1 << 20):
                found.update(block)
    return found.hexdigest()


def numbers(words: Sequence[str], names: Sequence[str], place: str) -> list[float]:
    """The words of one row as finite numbers."""
    values = []
    for word, name in zip(words, names, strict=True):
        try:
            value = float(word)
        except ValueError:
            shown = word.strip() or "nothing"
            raise RequestError(f"{place}: {name} is {shown}, not a number") from None
        if not np.isfinite(value):
            raise RequestError(f"{place}: {name} is {word.strip()}; remove the row")
        values.append(value)
    return values


def check_clock(time: Floats, place: Place) -> None:
    """Raises RequestError at the first row whose time is not later than the one before."""
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        i = int(late[0]) + 1
        what = "stands still" if time[i] == time[i - 1] else "runs backward"
        raise RequestError(
            f"{place(i)}: the clock {what} ({time[i - 1]:.9g} s, then {time[i]:.9g} s)"
        )


def check_pace(time: Floats, place: Place) -> None:
    """Raises RequestError for times that are no seconds, and for clocks that were set meanwhile."""
    steps = np.diff(time)
    paused = np.flatnonzero(steps > LONGEST_PAUSE)
    if paused.size:
        i = int(paused[0])
        raise RequestError(
            f"{place(i + 1)}: {steps[i]:.6g} s after the pose before it; are the times in seconds? "
            "Else split the log there, or leave out what was recorded before the clock was set"
        )


def log(poses: NDArray[np.float64], path: Path, place: Place) -> Log:
    """`poses` (n, 4) are time, x, y, heading in rad, finite; the heading is wrapped."""
    if len(poses) < 2:
        raise RequestError(f"{path}: {len(poses)} poses; a log needs at least 2")
    check_clock(poses[:, 0], place)
    check_pace(poses[:, 0], place)
    far = np.flatnonzero((np.abs(poses[:, 1:]) > FARTHEST).any(axis=1))
    if far.size:
        raise RequestError(f"{place(int(far[0]))}: a pose beyond {FARTHEST:g} m or rad; remove it")
    time, x, y, heading = (np.ascontiguousarray(column) for column in poses.T)
    return Log(time, x, y, angles.wrap(heading), str(path), digest(path), _warnings(heading, place))


def _warnings(heading: Floats, place: Place) -> tuple[str, ...]:
    beyond = np.flatnonzero(np.abs(heading) > 2 * np.pi * (1 + 1e-6))
    if not beyond.size:
        return ()
    i = int(beyond[0])
    return (
        f"{place(i)}: heading {heading[i]:.6g} rad is over a whole turn; if these are degrees, "
        "name the column heading_deg",
    )
