"""Rows of a CSV file with a line of column names, within bounds."""

from __future__ import annotations

import csv
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO

from s2rstore.errors import RequestError
from s2rstore.files.input_files import open_regular

_MOST_BYTES = 256 << 20
"""Of a file; a manifest has about 150 a row."""
_MOST_LINE = 1 << 20
"""Bytes of a line."""
_MOST_COLUMNS = 1000
_MOST_ROWS = 4_000_000
"""Of a manifest of 200,000 instances; kept, they take up to 400 MB."""


def read_rows(path: Path, columns: Collection[str]) -> Iterator[tuple[int, dict[str, str]]]:
    """Number of the last line, and stripped values by column, of each row.

    Other columns than the named ones are left out.

    Raises RequestError, naming file and line, for what is no CSV in UTF-8 or too large.
    """
    with open_regular(path) as file:
        if path.stat().st_size > _MOST_BYTES:
            raise RequestError(f"{path}: larger than {_MOST_BYTES:,} bytes; split it")
        reader = csv.reader(_lines(path, file))
        names: list[str] = []
        count = 0
        try:
            for values in reader:
                if not values:
                    continue
                if len(values) > _MOST_COLUMNS:
                    told = f"{len(values)} columns; at most {_MOST_COLUMNS} are read"
                    raise RequestError(f"{path}:{reader.line_num}: {told}")
                if not names:
                    names = [name.strip() for name in values]
                    continue
                count += 1
                if count > _MOST_ROWS:
                    raise RequestError(f"{path}: more than {_MOST_ROWS:,} rows; split it")
                values += [""] * (len(names) - len(values))
                pairs = zip(names, values, strict=False)
                yield reader.line_num, {k: v.strip() for k, v in pairs if k in columns}
        except csv.Error as error:
            raise RequestError(f"{path}:{reader.line_num}: no CSV ({error})") from error


def _lines(path: Path, file: BinaryIO) -> Iterator[str]:
    number = 0
    while line := file.readline(_MOST_LINE + 1):
        number += 1
        if len(line) > _MOST_LINE:
            raise RequestError(f"{path}:{number}: longer than {_MOST_LINE:,} bytes; no CSV")
        if b"\0" in line:
            raise RequestError(f"{path}:{number}: holds NUL bytes; no CSV")
        try:
            yield line.decode("utf-8-sig" if number == 1 else "utf-8")
        except UnicodeDecodeError as error:
            raise RequestError(f"{path}:{number}: not UTF-8; save it as UTF-8") from error
