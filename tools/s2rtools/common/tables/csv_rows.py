"""Read the rows of a CSV file that begins with column names, within size limits."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Collection, Iterator
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.security.printable_text import printable
from s2rtools.common.tables.text_lines import read_lines

_MAX_COLUMNS = 1000
_MAX_LISTED = 20
_MAX_NAME = 40
_OTHER_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}
_MAX_ROWS = 4_000_000
"""Rows of a file; 200,000 instances take up to 400 MB of memory."""


def read_rows(
    path: Path,
    columns: Collection[str] | None,
    check_names: Callable[[list[str]], object] = lambda names: None,
    has_comments: bool = False,
) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield the number of the last line and the stripped values by column of each row.

    Only the requested `columns` are returned, all where None. `check_names` is called with the
    names of all columns that the file has. In a file that `has_comments`, lines that begin with `#`
    are skipped, and every row has a value for each column. Raises RequestError, naming file and
    line, if the file is too large, not a CSV file in UTF-8, or separates columns by another
    character than a comma.
    """
    number = 0

    def lines() -> Iterator[str]:
        nonlocal number
        for number, line in read_lines(path, "CSV"):  # noqa: B007, the rows' numbers
            if not (has_comments and (line.isspace() or line.lstrip().startswith("#"))):
                yield line

    names: list[str] = []
    count = 0
    try:
        for values in csv.reader(lines()):
            if not values:
                continue
            if len(values) > _MAX_COLUMNS:
                limit = f"{len(values)} columns; at most {_MAX_COLUMNS} are read"
                raise RequestError(f"{path}:{number}: {limit}")
            if not names:
                names = [name.strip() for name in values]
                _check_separator(path, number, names)
                _check_repeated(path, number, names, names if columns is None else columns)
                check_names(names)
                continue
            count += 1
            if count > _MAX_ROWS:
                raise RequestError(f"{path}: more than {_MAX_ROWS:,} rows; split it")
            if has_comments and len(values) != len(names):
                raise RequestError(
                    f"{path}:{number}: {len(values)} values for {len(names)} columns"
                )
            values += [""] * (len(names) - len(values))
            pairs = zip(names, values, strict=False)
            yield number, {k: v.strip() for k, v in pairs if columns is None or k in columns}
    except csv.Error as error:
        raise RequestError(f"{path}:{number}: not a CSV file ({error})") from error


def _check_separator(path: Path, line: int, names: list[str]) -> None:
    """Raise RequestError for a line of names that another character separates."""
    for character, name in _OTHER_SEPARATORS.items():
        if len(names) == 1 and character in names[0]:
            raise RequestError(
                f"{path}:{line}: columns are separated by {name}; separate them by commas"
            )


def _check_repeated(path: Path, line: int, names: list[str], columns: Collection[str]) -> None:
    """Raise RequestError if a requested column exists twice: which one counts is unknown."""
    repeated = next((name for name in names if name in columns and names.count(name) > 1), None)
    if repeated is not None:
        shown = printable(repeated[:_MAX_NAME]) or "(no name)"
        raise RequestError(f"{path}:{line}: column {shown} exists more than once; keep one")


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
