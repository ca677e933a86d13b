"""Rows as a table, CSV, JSON or Parquet: one door for every command that prints rows."""

from __future__ import annotations

import argparse
import csv
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError

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
    text = {"table": _table, "csv": _csv, "json": _json}[options.format](names, rows)
    if options.out is None:
        sys.stdout.write(text)
        return
    try:
        options.out.write_text(text)
    except OSError as error:
        raise RequestError(f"{options.out}: cannot be written ({error.strerror})") from error


def _table(names: Sequence[str], rows: Rows) -> str:
    cells = [[_cell(value) for value in row] for row in rows]
    widths = [
        max([len(name), *(len(row[column]) for row in cells)]) for column, name in enumerate(names)
    ]
    numeric = [
        any(isinstance(row[column], int | float) for row in rows) for column in range(len(names))
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
    return str(value)


def _csv(names: Sequence[str], rows: Rows) -> str:
    import io

    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows)
    return buffer.getvalue()


def _json(names: Sequence[str], rows: Rows) -> str:
    listed = [{name: _plain(v) for name, v in zip(names, row, strict=True)} for row in rows]
    return json.dumps(listed, indent=1, default=str, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _parquet(names: Sequence[str], rows: Rows, target: Path) -> None:
    import duckdb

    with duckdb.connect() as connection:
        columns = ", ".join(f'"{name}" {_type(rows, i)}' for i, name in enumerate(names))
        connection.execute(f"CREATE TABLE result ({columns})")
        if rows:
            marks = ", ".join("?" * len(names))
            connection.executemany(f"INSERT INTO result VALUES ({marks})", [list(r) for r in rows])
        quoted = str(target).replace("'", "''")
        try:
            connection.execute(f"COPY result TO '{quoted}' (FORMAT parquet)")
        except duckdb.IOException as error:
            raise RequestError(f"{target}: cannot be written") from error


def _type(rows: Rows, column: int) -> str:
    values = [row[column] for row in rows if row[column] is not None]
    if values and all(isinstance(value, bool) for value in values):
        return "BOOLEAN"
    if values and all(isinstance(value, int) for value in values):
        return "BIGINT"
    if values and all(isinstance(value, int | float) for value in values):
        return "DOUBLE"
    return "VARCHAR"
