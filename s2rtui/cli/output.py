"""Rows as a table, CSV, JSON or Parquet: one door for every command that prints rows."""

from __future__ import annotations

import argparse
import csv
import json
import math
import sys
from collections.abc import Callable, Sequence
from datetime import datetime
from decimal import Decimal
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.text import printable

FORMATS = ("table", "csv", "json", "parquet")

Rows = Sequence[Sequence[Any]]


def add_format(parser: argparse.ArgumentParser, with_parquet: bool = True) -> None:
    """Add `--format`, `--json` and `--out` to a command."""
    formats = FORMATS if with_parquet else FORMATS[:-1]
    parser.add_argument("--format", choices=formats, default="table")
    parser.add_argument(
        "--json",
        action="store_const",
        dest="format",
        const="json",
        help="the same as --format json",
    )
    parser.add_argument("--out", type=Path, help="write to this file, not to standard output")


def write(names: Sequence[str], rows: Rows, options: argparse.Namespace) -> None:
    """Print rows in the chosen format. Raises RequestError for Parquet without `--out`."""
    if options.format == "parquet":
        if options.out is None:
            raise RequestError("--format parquet: give a file with --out")
        _parquet(names, rows, options.out)
        return
    text = {"table": table, "csv": _csv, "json": _json}[options.format](names, rows)
    if options.out is None:
        sys.stdout.write(text)
        return
    try:
        options.out.write_text(text)
    except OSError as error:
        raise RequestError(f"{options.out}: cannot be written ({error.strerror})") from error


def table(names: Sequence[str], rows: Rows) -> str:
    cells = [[_cell(value) for value in row] for row in rows]
    widths = [
        max([len(name), *(len(row[column]) for row in cells)]) for column, name in enumerate(names)
    ]
    numeric = [
        any(isinstance(row[column], int | float | Decimal) for row in rows)
        for column in range(len(names))
    ]

    def line(values: Sequence[str]) -> str:
        padded = (
            value.rjust(width) if right else value.ljust(width)
            for value, width, right in zip(values, widths, numeric, strict=True)
        )
        return "  ".join(padded).rstrip()

    rule = "  ".join("-" * width for width in widths)
    return "\n".join([line(names), rule, *(line(row) for row in cells)]) + "\n"


def _cell(value: Any) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1e6 else f"{value:.6g}"
    return printable(str(value)).replace("\n", " ")


def _csv(names: Sequence[str], rows: Rows) -> str:
    import io

    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows)
    return buffer.getvalue()


def _json(names: Sequence[str], rows: Rows) -> str:
    _distinct(names)
    listed = [{name: _plain(v) for name, v in zip(names, row, strict=True)} for row in rows]
    return json.dumps(listed, indent=1, default=str, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, Decimal):
        value = float(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _distinct(names: Sequence[str]) -> None:
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise RequestError(f"column {twice[0]!r} is there twice; name one of them with AS")


def _parquet(names: Sequence[str], rows: Rows, target: Path) -> None:
    """Columns go in by position, because their names are the user's text."""
    import duckdb

    _distinct(names)
    types = [_type(rows, column) for column in range(len(names))]
    with duckdb.connect() as connection:
        columns = ", ".join(f"c{number} {name}" for number, (name, _) in enumerate(types))
        connection.execute(f"CREATE TABLE result ({columns})")
        if rows:
            marks = ", ".join("?" * len(names))
            values = [[None if v is None else make(v) for v, (_, make) in zip(row, types)]  # noqa: B905
                      for row in rows]  # fmt: skip
            connection.executemany(f"INSERT INTO result VALUES ({marks})", values)
        renamed = ", ".join(
            'c{} AS "{}"'.format(number, name.replace('"', '""'))
            for number, name in enumerate(names)
        )
        quoted = str(target).replace("'", "''")
        try:
            connection.execute(
                f"COPY (SELECT {renamed} FROM result) TO '{quoted}' (FORMAT parquet)"
            )
        except duckdb.Error as error:
            reason = str(error).splitlines()[0]
            raise RequestError(f"{target}: cannot be written ({reason})") from error


def _type(rows: Rows, column: int) -> tuple[str, Callable[[Any], Any]]:
    """The narrowest type that holds a column, and what brings its values there."""
    values = [row[column] for row in rows if row[column] is not None]
    if values and all(isinstance(value, bool) for value in values):
        return "BOOLEAN", bool
    if values and all(isinstance(v, int) and abs(v) < 2**63 for v in values):
        return "BIGINT", int
    if values and all(isinstance(value, int | float | Decimal) for value in values):
        return "DOUBLE", float
    if values and all(isinstance(value, datetime) for value in values):
        return "TIMESTAMP", lambda value: value
    return "VARCHAR", str
