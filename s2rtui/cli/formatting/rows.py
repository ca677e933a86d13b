"""Rows as a table, CSV, JSON or Parquet: one door for every command that prints rows."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes
from s2rstore.security.printable_text import printable
from s2rtui.export.rows.formats import Rows, Told, csv_text, json_text, write_parquet

FORMATS = ("table", "csv", "json", "parquet")


def add_format(parser: argparse.ArgumentParser, with_parquet: bool = True) -> None:
    """Add `--format`, `--json`, `--out` and `--safe-csv` to a command."""
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
    add_safe_csv(parser)


def add_safe_csv(parser: argparse.ArgumentParser) -> None:
    """Add `--safe-csv` to a command."""
    parser.add_argument(
        "--safe-csv", action="store_true",
        help="CSV for spreadsheets: text that could run as a formula begins with an apostrophe",
    )  # fmt: skip


def write(
    names: Sequence[str], rows: Rows, options: argparse.Namespace, facts: Told | None = None
) -> None:
    """Print rows in the chosen format, with facts about them where asked for.

    Raises RequestError for Parquet without `--out`.
    """
    if options.format == "parquet":
        if options.out is None:
            raise RequestError("--format parquet: give a file with --out")
        write_parquet(names, rows, options.out, facts)
        return
    if options.format == "csv":
        text = csv_text(names, rows, facts, options.safe_csv)
    else:
        text = {"table": table, "json": json_text}[options.format](names, rows, facts)
    if options.out is None:
        sys.stdout.write(text)
        return
    write_file(options.out, text.encode(errors="backslashreplace"))


def write_file(path: Path, content: bytes) -> None:
    """Whole or not at all, unless it is a device or a pipe. Raises RequestError."""
    try:
        if path.exists() and not path.is_file():
            path.write_bytes(content)
        else:
            atomic_writes.write_file(path.resolve(), content)
    except OSError as error:
        raise RequestError(f"{path}: cannot be written ({error.strerror})") from error


def table(names: Sequence[str], rows: Rows, facts: Told | None = None) -> str:
    """Aligned columns under their names; before them a `key: value` line per fact."""
    names = [_cell(name) for name in names]
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
    told = [f"{key}: {_cell(value)}" for key, value in (facts or {}).items()]
    return "\n".join([*told, line(names), rule, *(line(row) for row in cells)]) + "\n"


def _cell(value: Any) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1e6 else f"{value:.6g}"
    return printable(str(value))
