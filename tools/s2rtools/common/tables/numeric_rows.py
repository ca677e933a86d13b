"""Read rows of numbers from text files, report bad ones, and put time stamps into order."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError, counted
from s2rstore.files.input_files import read_text
from s2rstore.lazy_sequence import RowFile
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.tables.text_lines import read_lines

POSE_COLUMNS = ("time", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
"""The numbers of a line of a TUM file: seconds, metres, and a quaternion."""
_MAX_ROWS = 4_000_000
"""Rows of a file; ground truth of 200 Hz has 720,000 in an hour."""
_MAX_MATRIX_BYTES = 16 << 10


@dataclass(frozen=True, slots=True, eq=False)
class NumericRows:
    """`values` (N, columns) float64 and the numbers of their `lines` (N,) in the file `name`.

    `texts` are what stands behind the numbers of each row, where that was requested.
    """

    name: str
    values: NDArray[np.float64]
    lines: NDArray[np.int32]
    texts: RowFile | None = None

    def place(self, row: int) -> str:
        """`FILE:LINE` of a row."""
        return f"{self.name}:{self.lines[row]}"

    def chosen(self, rows: NDArray[np.intp]) -> NumericRows:
        """The numbers of the given rows, in their order, without texts."""
        return NumericRows(self.name, self.values[rows], self.lines[rows])

    def text(self, row: int) -> str:
        """What stands behind the numbers of a row."""
        assert self.texts is not None
        return str(self.texts[row][0])


def read_numbers(
    path: Path,
    name: str,
    columns: int,
    issues: list[InputIssue],
    separator: str | None = None,
    more: bool = False,
    keep_bad: bool = False,
) -> NumericRows:
    """The rows of a file with `columns` numbers in each line.

    Empty lines and those that begin with `#` are skipped. A line of another number of values, or
    with a text that is not a number, is left out and reported, or with `keep_bad` read as NaN;
    `nan` and `inf` are numbers. With `more` further values are ignored. `name` names the file in
    reports. Raises RequestError if the file cannot be read or no line is usable.
    """
    values, lines = array("d"), array("i")
    first, good = "", 0
    for number, text in _rows(path):
        fields = text.split(separator)
        try:
            if len(fields) < columns or (len(fields) > columns and not more):
                raise ValueError(f"{len(fields)} values, expected {columns}")
            values.extend([float(field) for field in fields[:columns]])
            good += 1
        except ValueError as error:
            issues.append(InputIssue("bad row", f"{name}:{number}", str(error)))
            first = first or f"; line {number}: {error}"
            if not keep_bad:
                continue
            values.extend([math.nan] * columns)
        lines.append(number)
    if not good:
        raise RequestError(f"{path}: no row of {columns} numbers{first}")
    table = np.asarray(values).reshape(-1, columns)
    return NumericRows(name, table, np.asarray(lines, dtype=np.int32))


def read_stamped_names(
    path: Path, name: str, issues: list[InputIssue], separator: str | None = None
) -> NumericRows:
    """The rows of a file with a time, and behind it a file name; see `read_numbers`."""
    times, lines, names = array("d"), array("i"), RowFile()
    first = ""
    for number, text in _rows(path):
        fields = text.split(separator, 1)
        try:
            if len(fields) != 2 or not fields[1].strip():
                raise ValueError("no file name behind the time")
            times.append(float(fields[0]))
        except ValueError as error:
            issues.append(InputIssue("bad row", f"{name}:{number}", str(error)))
            first = first or f"; line {number}: {error}"
            continue
        lines.append(number)
        names.append(fields[1].strip())
    if not lines:
        raise RequestError(f"{path}: no row of a time and a file name{first}")
    return NumericRows(name, np.asarray(times)[:, None], np.asarray(lines, dtype=np.int32), names)


def _rows(path: Path) -> Iterator[tuple[int, str]]:
    count = 0
    for number, line in read_lines(path):
        text = line.strip()
        if not text or text.startswith("#"):
            continue
        count += 1
        if count > _MAX_ROWS:
            raise RequestError(f"{path}: more than {_MAX_ROWS:,} rows; split it")
        yield number, text


def read_matrix(path: Path, rows: int, columns: int) -> NDArray[np.float64]:
    """The numbers of a small file as (rows, columns); NaN and infinity are numbers.

    Raises RequestError if the file has another number of values, or other content.
    """
    fields = read_text(path, _MAX_MATRIX_BYTES).split()
    if len(fields) != rows * columns:
        raise RequestError(f"{path}: {len(fields)} values, expected {rows} x {columns}")
    try:
        values = [float(field) for field in fields]
    except ValueError as error:
        raise RequestError(f"{path}: {error}") from error
    return np.array(values).reshape(rows, columns)


def in_time_order(rows: NumericRows, issues: list[InputIssue]) -> NDArray[np.intp]:
    """Rows (N,) by ascending time, which is the first column.

    Rows without a finite time, and those that repeat the time of an earlier line, are left out and
    reported. Times that do not ascend in the file are reported once.
    """
    times = rows.values[:, 0]
    finite = np.isfinite(times)
    issues += [
        InputIssue("bad time", rows.place(row), str(times[row]))
        for row in np.flatnonzero(~finite).tolist()
    ]
    kept = np.flatnonzero(finite)
    earlier = np.flatnonzero(np.diff(times[kept]) < 0)
    if len(earlier):
        late = counted(len(earlier), "row")
        detail = f"sorted by time; {late} with an earlier time than the row before"
        issues.append(
            InputIssue("times not in order", rows.place(int(kept[earlier[0] + 1])), detail)
        )
    order = kept[np.argsort(times[kept], kind="stable")]
    repeated = np.zeros(len(order), dtype=bool)
    repeated[1:] = np.diff(times[order]) == 0
    issues += [
        InputIssue("repeated time", rows.place(row), "the first one counts")
        for row in np.sort(order[repeated]).tolist()
    ]
    return order[~repeated]
