"""Read the rows of a file of predictions: CSV, Parquet or TUM.

A row of a CSV or Parquet file names its instance, its side and a pose, in the columns of `COLUMNS`;
other columns are ignored. A row of a TUM file is `timestamp tx ty tz qx qy qz qw`.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.index import parquet_table
from s2rstore.records import SIDES
from s2rstore.security.printable_text import printable
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.tables.csv_rows import parse_float, read_rows
from s2rtools.common.tables.numeric_rows import POSE_COLUMNS, read_numbers

NUMBERS: dict[str, str] = {
    "iid": "iid", "seq": "seq", "timestamp": "timestamp", "time": "timestamp",
    "x": "x", "tx": "x", "y": "y", "ty": "y",
    "heading": "heading", "yaw": "heading", "theta": "heading", "heading_deg": "heading_deg",
    "heading_rad": "heading_rad", "x_m": "x", "y_m": "y",
    "qx": "qx", "qy": "qy", "qz": "qz", "qw": "qw", "sigma": "sigma", "sigma_m": "sigma_m",
    **{f"{side}_{name}": f"{side}_{name}"
       for side in ("sim", "real")
       for name in ("x", "y", "heading", "heading_deg", "heading_rad", "sigma", "sigma_m")},
    **{f"{side}_{axis}_m": f"{side}_{axis}" for side in ("sim", "real") for axis in "xy"},
}  # fmt: skip
"""Columns of numbers and what they mean."""
SIGMA_IS = "must be a finite number above 0, or empty"
"""What is wrong with a sigma that is refused."""
TEXTS: dict[str, str] = {
    "side": "side", "domain": "domain", "trajectory": "trajectory", "image": "image",
    "rgb_path": "image", "path": "image", "split": "split", "sim_split": "sim_split",
    "real_split": "real_split",
}  # fmt: skip
"""Columns of texts and what they mean."""
COLUMNS = {**NUMBERS, **TEXTS}
"""All columns that are read; several names may mean the same."""
_MAX_LISTED = 20
_TUM = {"time": "timestamp", "tx": "x", "ty": "y", **{f"q{axis}": f"q{axis}" for axis in "xyzw"}}
"""The columns of a TUM file that are used, and what they mean."""


@dataclass(frozen=True, slots=True, eq=False)
class PredictionTable:
    """The rows of a file: `numbers` float64 (n,), NaN where there is none, and `texts` (n,).

    Both are by the names of `COLUMNS`'s values. `lines` (n,) are those of the file, `lines_are`
    says what they count. `columns` are the names of those that are read, `found` of all that the
    file has.
    """

    path: Path
    lines: NDArray[np.integer[Any]]
    numbers: Mapping[str, NDArray[np.float64]]
    texts: Mapping[str, NDArray[Any]]
    columns: tuple[str, ...]
    lines_are: str = "line"
    issues: list[InputIssue] = field(default_factory=list)
    found: tuple[str, ...] = ()

    @property
    def found_text(self) -> str:
        """The columns that the file has, for messages."""
        names = self.found or self.columns
        more = f" and {len(names) - _MAX_LISTED} more" if len(names) > _MAX_LISTED else ""
        return printable(", ".join(names[:_MAX_LISTED])) + more

    def __len__(self) -> int:
        return len(self.lines)

    def report(self, kind: str, rows: Iterable[int], detail: Callable[[int], str]) -> None:
        """Add an issue for each of `rows`."""
        self.issues.extend(InputIssue(kind, self.place(row), detail(row)) for row in rows)

    def place(self, row: int) -> str:
        """Where a row is, such as `predictions.csv:12`."""
        line = int(self.lines[row])
        return f"{self.path.name}:{line}" if self.lines_are == "line" else f"row {line}"


def read_table(path: Path) -> PredictionTable:
    """Read a file of predictions by its suffix. Raises RequestError where it is malformed."""
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise RequestError(f"{path}: unknown suffix (known: {', '.join(READERS)})")
    table = reader(path)
    if not len(table):
        raise RequestError(f"{path}: no rows")
    return table


def sigmas_of(
    table: PredictionTable, rows: NDArray[np.int64], sides: NDArray[np.int8], is_wide: bool,
    scale: float,
) -> NDArray[np.float64]:  # fmt: skip
    """The sigmas (n,) of predictions in metres, NaN where the file states none.

    `rows` of the table and `sides`, indexes into `SIDES`, (n,); a row of a table that `is_wide`
    holds both. Column `sigma` is in the unit of the positions, of which one is `scale` metres;
    `sigma_m` in metres. Raises RequestError for a sigma that is not finite or not above 0.
    """
    sigmas = np.full(len(rows), np.nan)
    for code, side in enumerate(SIDES):
        prefix, of_side = f"{side}_" if is_wide else "", sides == code
        for name, factor in ((f"{prefix}sigma", scale), (f"{prefix}sigma_m", 1.0)):
            if name not in table.numbers:
                continue
            values = table.numbers[name] * factor
            wrong = np.flatnonzero(~np.isnan(values) & ~((values > 0) & np.isfinite(values)))
            if wrong.size:
                place, value = table.place(int(wrong[0])), table.numbers[name][wrong[0]]
                raise RequestError(f"{table.path}: {place}: {name} {value:g}: {SIGMA_IS}")
            sigmas[of_side] = values[rows[of_side]]
    return sigmas


def _read_csv(path: Path) -> PredictionTable:
    lines = array("q")
    columns: dict[str, array[float] | list[str]] = {}
    found: list[str] = []
    for line, row in read_rows(path, COLUMNS, found.extend):
        if not columns:
            columns = {name: array("d") if name in NUMBERS else [] for name in row}
        lines.append(line)
        for name, values in columns.items():
            if isinstance(values, list):
                values.append(row[name])
            else:
                values.append(_number(path, line, name, row[name]))
    arrays = {
        name: np.array(values, dtype=object if isinstance(values, list) else np.float64)
        for name, values in columns.items()
    }
    return _table(path, np.array(lines, dtype=np.int64), arrays, "line", found)


def _number(path: Path, line: int, name: str, text: str) -> float:
    """Parse a number, NaN where missing. Raises RequestError for a sigma that is no number."""
    number = parse_float(text)
    is_missing = not text or text.lower() == "nan"
    if number != number and not is_missing and "sigma" in NUMBERS[name]:
        raise RequestError(f"{path}:{line}: {name} {text!r}: {SIGMA_IS}")
    return number


def _read_parquet(path: Path) -> PredictionTable:
    columns = parquet_table.read_columns(path, NUMBERS, TEXTS)
    count = len(next(iter(columns.values()))) if columns else 0
    return _table(path, np.arange(1, count + 1), columns, "row")


def _repeated(names: Collection[str]) -> set[str]:
    """Names without units of columns that are there with their units: view `pair` has both."""
    with_units = {name for name in names if name.endswith(("_m", "_rad"))}
    return {name.rpartition("_")[0] for name in with_units}


def _table(
    path: Path,
    lines: NDArray[np.int64],
    columns: Mapping[str, NDArray[Any]],
    lines_are: str,
    found: Sequence[str] = (),
) -> PredictionTable:
    """The table with the names of `COLUMNS`'s values. Raises RequestError for repeated ones."""
    columns = {name: values for name, values in columns.items() if name not in _repeated(columns)}
    by_meaning: dict[str, str] = {}
    for name in columns:
        other = by_meaning.setdefault(COLUMNS[name], name)
        if other != name:
            raise RequestError(f"{path}: columns {other} and {name} mean the same; remove one")
    return PredictionTable(
        path,
        lines,
        {NUMBERS[name]: values for name, values in columns.items() if name in NUMBERS},
        {TEXTS[name]: values for name, values in columns.items() if name in TEXTS},
        tuple(columns),
        lines_are,
        found=tuple(found),
    )


def _read_tum(path: Path) -> PredictionTable:
    issues: list[InputIssue] = []
    rows = read_numbers(path, path.name, len(POSE_COLUMNS), issues, keep_bad=True)
    numbers = {_TUM[name]: rows.values[:, k] for k, name in enumerate(POSE_COLUMNS) if name in _TUM}
    return PredictionTable(path, rows.lines, numbers, {}, tuple(_TUM.values()), issues=issues)


READERS = {".csv": _read_csv, ".parquet": _read_parquet, ".tum": _read_tum, ".txt": _read_tum}
"""Readers by suffix."""
