"""Motion logs and commands as CSV files with a header line.

A log has the columns `time` (s), `x`, `y` (m) and `heading` (rad) or `heading_deg`; other columns
are ignored. Commands have `time` and any channels; a line `# period = 0.05` above the header gives
the controller's period in s, otherwise it is the median step. Lines that begin with `#` are
comments.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.motion_logs import row_checks
from s2rtools.motion_logs.motion_log import Commands, Log

_POSITION = ("time", "x", "y")
_PERIOD = re.compile(r"#\s*period\s*[=:]\s*(?P<value>.*)", re.IGNORECASE)


def read(path: Path) -> Log:
    """Read a log. Raises RequestError with the line number for an invalid file."""
    names, rows, lines = _table(path)
    degrees = "heading" not in names
    columns = (*_POSITION, "heading_deg" if degrees else "heading")
    for name in columns:
        if name not in names:
            expected = "heading (rad) or heading_deg" if name == "heading_deg" else name
            raise RequestError(f"{path}: no column {expected} (has: {', '.join(names)})")
    poses = _numbers(path, names, rows, lines, columns)
    if degrees:
        poses[:, 3] = angles.wrap(np.radians(poses[:, 3]))
    return row_checks.log(poses, path, lambda i: f"{path}:{lines[i]}")


def read_commands(path: Path) -> Commands:
    """Read commands. Raises RequestError with the line number for an invalid file."""
    names, rows, lines = _table(path)
    if "time" not in names:
        raise RequestError(f"{path}: no column time (has: {', '.join(names)})")
    channels = [name for name in names if name != "time"]
    if not channels:
        raise RequestError(f"{path}: no channels, only the column time")
    table = _numbers(path, names, rows, lines, ("time", *channels))
    time = np.ascontiguousarray(table[:, 0])
    row_checks.check_clock(time, lambda i: f"{path}:{lines[i]}")
    values = {name: np.ascontiguousarray(table[:, 1 + i]) for i, name in enumerate(channels)}
    return Commands(time, values, _period(path, time), str(path), row_checks.digest(path))


def write(log: Log, path: Path) -> None:
    """Write a log so that `read` returns exactly the same numbers."""
    _write(path, (*_POSITION, "heading"), [log.time, log.x, log.y, log.heading])


def write_commands(commands: Commands, path: Path) -> None:
    """Write commands so that `read_commands` returns exactly the same numbers and period."""
    columns = [commands.time, *commands.channels.values()]
    _write(path, ("time", *commands.channels), columns, f"# period = {commands.period!r}\n")


def _write(
    path: Path, names: tuple[str, ...], columns: list[NDArray[np.float64]], head: str = ""
) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        file.write(head)
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        writer.writerows(zip(*(map(repr, column.tolist()) for column in columns), strict=True))


def _table(path: Path) -> tuple[list[str], list[list[str]], list[int]]:
    """Column names, rows of texts, and the line number of each row."""
    rows: list[list[str]] = []
    lines: list[int] = []
    for number, line in enumerate(row_checks.text_of(path).splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            rows.append(next(csv.reader([line])))
        except csv.Error as error:
            raise RequestError(f"{path}:{number}: cannot be read ({error})") from error
        lines.append(number)
    if not rows:
        raise RequestError(f"{path}: no line of column names")
    names = [name.strip() for name in rows[0]]
    repeated = [name for name in names if names.count(name) > 1]
    if repeated:
        raise RequestError(f"{path}:{lines[0]}: column {repeated[0] or '(no name)'} is repeated")
    if len(rows) == 1:
        raise RequestError(f"{path}: no rows below the column names")
    return names, rows[1:], lines[1:]


def _numbers(
    path: Path, names: list[str], rows: list[list[str]], lines: list[int], columns: tuple[str, ...]
) -> NDArray[np.float64]:
    """The named columns (n, k) as finite numbers."""
    at = [names.index(name) for name in columns]
    table = np.empty((len(rows), len(columns)))
    for i, (row, line) in enumerate(zip(rows, lines, strict=True)):
        if len(row) != len(names):
            raise RequestError(f"{path}:{line}: {len(row)} values for {len(names)} columns")
        table[i] = row_checks.numbers([row[j] for j in at], columns, f"{path}:{line}")
    return table


def _period(path: Path, time: NDArray[np.float64]) -> float:
    for number, line in enumerate(row_checks.text_of(path).splitlines(), start=1):
        if match := _PERIOD.match(line.strip()):
            place = f"{path}:{number}"
            (period,) = row_checks.numbers([match["value"]], ["period"], place)
            if period <= 0:
                raise RequestError(f"{place}: period is {period:g} s; it must be positive")
            return period
    if time.size < 2:
        raise RequestError(f"{path}: one row and no period; add a line `# period = 0.05`")
    return float(np.median(np.diff(time)))
