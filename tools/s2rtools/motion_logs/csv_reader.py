"""Motion logs and commands as CSV files with a header line.

A log has the columns `time` (s), `x`, `y` (m) and `heading` (rad) or `heading_deg`; other columns
are ignored. Commands have `time` and any channels; a line `# period = 0.05` above the header gives
the controller's period in s, otherwise it is the median step. Lines that begin with `#` are
comments.
"""

from __future__ import annotations

import csv
import re
from array import array
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.common.tables.csv_rows import missing_column, read_rows
from s2rtools.common.tables.text_lines import read_lines
from s2rtools.motion_logs import row_checks
from s2rtools.motion_logs.motion_log import Commands, Log

_POSITION = ("time", "x", "y")
_HEADINGS = ("heading", "heading_deg")
_PERIOD = re.compile(r"#\s*period\s*[=:]\s*(?P<value>.*)", re.IGNORECASE)


def read(path: Path) -> Log:
    """Read a log. Raises RequestError with the line number for an invalid file."""

    def chosen(names: list[str]) -> list[str]:
        for name in _POSITION:
            if name not in names:
                raise missing_column(path, name, names, ", ".join((*_POSITION, _HEADINGS[0])))
        headings = [name for name in _HEADINGS if name in names]
        if not headings:
            raise missing_column(path, "heading (rad) or heading_deg", names, ", ".join(_POSITION))
        return [*_POSITION, headings[0]]

    columns, poses, place = _table(path, chosen)
    if columns[-1] == "heading_deg":
        poses[:, 3] = angles.wrap(np.radians(poses[:, 3]))
    return row_checks.log(poses, path, place)


def read_commands(path: Path) -> Commands:
    """Read commands. Raises RequestError with the line number for an invalid file."""

    def chosen(names: list[str]) -> list[str]:
        if "time" not in names:
            raise missing_column(path, "time", names, "time and channels")
        channels = [name for name in names if name != "time"]
        if not channels:
            raise RequestError(f"{path}: no channels, only the column time")
        return ["time", *channels]

    columns, table, place = _table(path, chosen)
    time, *channels = (np.ascontiguousarray(column) for column in table.T)
    row_checks.check_clock(time, place)
    values = dict(zip(columns[1:], channels, strict=True))
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


def _table(
    path: Path, choose: Callable[[list[str]], list[str]]
) -> tuple[list[str], NDArray[np.float64], row_checks.Place]:
    """The columns that `choose` names, their finite numbers (n, k), and the place of each row."""
    columns: list[str] = []
    values, lines = array("d"), array("q")
    rows = read_rows(path, None, lambda names: columns.extend(choose(names)), has_comments=True)
    for line, row in rows:
        values.extend(
            row_checks.numbers([row[name] for name in columns], columns, f"{path}:{line}")
        )
        lines.append(line)
    if not lines:
        raise RequestError(f"{path}: no rows below a line of column names")
    return columns, np.array(values).reshape(len(lines), -1), lambda i: f"{path}:{lines[i]}"


def _period(path: Path, time: NDArray[np.float64]) -> float:
    for number, line in read_lines(path, "CSV"):
        if match := _PERIOD.match(line.strip()):
            place = f"{path}:{number}"
            (period,) = row_checks.numbers([match["value"]], ["period"], place)
            if period <= 0:
                raise RequestError(f"{place}: period is {period:g} s; it must be positive")
            return period
    if time.size < 2:
        raise RequestError(f"{path}: one row and no period; add a line `# period = 0.05`")
    return float(np.median(np.diff(time)))
