"""Read the rows of a CSV file that begins with column names, within size limits."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Collection, Iterator
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.security.printable_text import printable
from s2rtools.datasets.files.text_lines import read_lines

_MAX_COLUMNS = 1000
_MAX_LISTED = 20
_MAX_NAME = 40
_OTHER_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}
_MAX_ROWS = 4_000_000
"""Rows of a file; 200,000 instances take up to 400 MB of memory."""


def read_rows(
    path: Path,
    columns: Collection[str],
    check_names: Callable[[list[str]], object] = lambda names: None,
) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield the number of the last line and the stripped values by column of each row.

    Only the requested `columns` are returned. `check_names` is called with the names of all columns
    that the file has. Raises RequestError, naming file and line, if the file is too large, not a
    CSV file in UTF-8, or separates columns by another character than a comma.
    """
    reader = csv.reader(line for _, line in read_lines(path, "CSV"))
    names: list[str] = []
    count = 0
    try:
        for values in reader:
            if not values:
                continue
            if len(values) > _MAX_COLUMNS:
                limit = f"{len(values)} columns; at most {_MAX_COLUMNS} are read"
                raise RequestError(f"{path}:{reader.line_num}: {limit}")
            if not names:
                names = [name.strip() for name in values]
                _check_separator(path, names)
                _check_repeated(path, names, columns)
                check_names(names)
                continue
            count += 1
            if count > _MAX_ROWS:
                raise RequestError(f"{path}: more than {_MAX_ROWS:,} rows; split it")
            values += [""] * (len(names) - len(values))
            pairs = zip(names, values, strict=False)
            yield reader.line_num, {k: v.strip() for k, v in pairs if k in columns}
    except csv.Error as error:
        raise RequestError(f"{path}:{reader.line_num}: not a CSV file ({error})") from error


def _check_separator(path: Path, names: list[str]) -> None:
    """Raise RequestError for a line of names that another character separates."""
    for character, name in _OTHER_SEPARATORS.items():
        if len(names) == 1 and character in names[0]:
            raise RequestError(
                f"{path}:1: columns are separated by {name}; separate them by commas"
            )


def _check_repeated(path: Path, names: list[str], columns: Collection[str]) -> None:
    """Raise RequestError if a requested column exists twice: which one counts is unknown."""
    repeated = next((name for name in names if name in columns and names.count(name) > 1), None)
    if repeated is not None:
        raise RequestError(f"{path}:1: column {repeated} exists more than once; keep one")


def missing_column(path: Path, name: str, found: Collection[str], needed: str) -> RequestError:
    """The error for a file without a column; `found` are those that it has."""
    listed = [printable(each[:_MAX_NAME]) for each in found][:_MAX_LISTED]
    more = f" and {len(found) - _MAX_LISTED} more" if len(found) > _MAX_LISTED else ""
    has = f"{', '.join(listed)}{more}"
    return RequestError(f"{path}: no column {name} (has: {has}; needs: {needed})")


def parse_float(text: str | None) -> float:
    """The number in a text; NaN for a missing value or one that is not a number."""
    try:
        return float(text) if text else math.nan
    except ValueError:
        return math.nan
