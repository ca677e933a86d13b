"""Read the rows of a CSV file that begins with column names, within size limits."""

from __future__ import annotations

import csv
import math
from collections.abc import Collection, Iterator
from pathlib import Path

from s2rstore.errors import RequestError
from s2rtools.datasets.files.text_lines import read_lines

_MAX_COLUMNS = 1000
_MAX_ROWS = 4_000_000
"""Rows of a file; 200,000 instances take up to 400 MB of memory."""


def read_rows(path: Path, columns: Collection[str]) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield the number of the last line and the stripped values by column of each row.

    Only the requested `columns` are returned. Raises RequestError, naming file and line, if the
    file is too large or not a CSV file in UTF-8.
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
                continue
            count += 1
            if count > _MAX_ROWS:
                raise RequestError(f"{path}: more than {_MAX_ROWS:,} rows; split it")
            values += [""] * (len(names) - len(values))
            pairs = zip(names, values, strict=False)
            yield reader.line_num, {k: v.strip() for k, v in pairs if k in columns}
    except csv.Error as error:
        raise RequestError(f"{path}:{reader.line_num}: not a CSV file ({error})") from error


def parse_float(text: str | None) -> float:
    """The number in a text; NaN for a missing value or one that is not a number."""
    try:
        return float(text) if text else math.nan
    except ValueError:
        return math.nan
