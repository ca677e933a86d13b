"""Output of rows as a table, CSV, JSON or Parquet, shared by all commands that print rows."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterable, Sequence
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.cells import cell_len

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes
from s2rstore.security.printable_text import printable
from s2rtools.common.command_line.row_formats import (
    Metadata,
    Rows,
    csv_text,
    json_text,
    write_parquet,
)

if TYPE_CHECKING:
    from s2rstore.reader import Store

FORMATS = ("table", "csv", "json", "parquet")


def add_output_options(parser: argparse.ArgumentParser, with_parquet: bool = True) -> None:
    """Add `--format`, `--json`, `--out` and `--safe-csv` to a command."""
    group = parser.add_argument_group("output")
    group.add_argument("--format", choices=FORMATS if with_parquet else FORMATS[:-1],
                       default="table", help="output format (default table)")  # fmt: skip
    group.add_argument("--json", action="store_const", dest="format", const="json",
                       help="same as --format json")  # fmt: skip
    group.add_argument("--out", type=Path, metavar="FILE",
                       help="write to this file (default: standard output)")  # fmt: skip
    add_safe_csv(group)


def add_safe_csv(parser: argparse._ActionsContainer) -> None:
    """Add `--safe-csv` to a command or a group of options."""
    parser.add_argument("--safe-csv", action="store_true",
                        help="write CSV for spreadsheets: text that could be a formula begins with "
                        "an apostrophe")  # fmt: skip


def write(
    names: Sequence[str],
    rows: Rows,
    options: argparse.Namespace,
    metadata: Metadata | None = None,
) -> None:
    """Write rows in the requested format to `--out` or standard output.

    Raises RequestError for Parquet without `--out`.
    """
    if options.format == "parquet":
        if options.out is None:
            raise RequestError("--format parquet: needs --out FILE")
        write_parquet(names, rows, options.out, metadata)
        return
    if options.format == "csv":
        text = csv_text(names, rows, metadata, options.safe_csv)
    else:
        text = {"table": table, "json": json_text}[options.format](names, rows, metadata)
    if options.out is None:
        sys.stdout.write(text)
        return
    write_file(options.out, text.encode(errors="backslashreplace"))


def write_file(path: Path, content: bytes) -> None:
    """Write a file atomically, or write to a device or pipe. Raises RequestError."""
    try:
        if path.exists() and not path.is_file():
            path.write_bytes(content)
        else:
            atomic_writes.write_file(path.resolve(), content)
    except OSError as error:
        raise RequestError(f"{path}: cannot be written ({error.strerror})") from error


def table(names: Sequence[str], rows: Rows, metadata: Metadata | None = None) -> str:
    """Return aligned columns under their names, after one `key: value` line per metadata entry."""
    names = [_cell(name) for name in names]
    cells = [[_cell(value) for value in row] for row in rows]
    widths = [max(map(cell_len, column)) for column in zip(names, *cells, strict=True)]
    numeric = [
        any(isinstance(row[column], int | float | Decimal) for row in rows)
        for column in range(len(names))
    ]

    def line(values: Sequence[str]) -> str:
        padded = (
            f"{' ' * (width - cell_len(value))}{value}" if right
            else f"{value}{' ' * (width - cell_len(value))}"
            for value, width, right in zip(values, widths, numeric, strict=True)
        )  # fmt: skip
        return "  ".join(padded).rstrip()

    rule = "  ".join("-" * width for width in widths)
    header = [f"{key}: {_cell(value)}" for key, value in (metadata or {}).items()]
    return "\n".join([*header, line(names), rule, *(line(row) for row in cells)]) + "\n"


def _cell(value: Any) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1e6 else f"{value:.6g}"
    return printable(str(value))


def print_coverage(store: Store, runs: Iterable[str | None]) -> None:
    """Print a line on standard error for each run that is computed for some instances only."""
    for run in dict.fromkeys(runs):
        if run and (note := store.coverage(run).note):
            print(note, file=sys.stderr)
