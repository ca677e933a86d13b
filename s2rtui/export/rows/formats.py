"""A file of rows in the format of its suffix."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from s2rtools.common.command_line.row_formats import (
    Metadata,
    Rows,
    csv_text,
    json_text,
    write_parquet,
)


def write_rows(
    target: Path,
    names: Sequence[str],
    rows: Rows,
    metadata: Metadata | None = None,
    safe_csv: bool = False,
) -> None:
    """Write a file in the format of its suffix. Raises RequestError, OSError."""
    if target.suffix == ".parquet":
        write_parquet(names, rows, target, metadata)
    elif target.suffix == ".csv":
        target.write_text(csv_text(names, rows, metadata, safe_csv), encoding="utf-8")
    else:
        target.write_text(json_text(names, rows, metadata), encoding="utf-8")
