"""Rows as CSV, JSON and Parquet, with metadata where the format has a place for it."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.security.printable_text import printable

_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d", "\uff0b", "\uff0d", "\uff20")
"""First characters of a cell that a spreadsheet may run; the last four are full-width signs."""
Rows = Sequence[Sequence[Any]]
Metadata = Mapping[str, Any]


def csv_text(
    names: Sequence[str], rows: Rows, metadata: Metadata | None = None, safe: bool = False
) -> str:
    """Return a `# key: value` line per metadata entry, a line of names, and the rows.

    With `safe`, no spreadsheet runs a cell as a formula: every text is quoted, and an apostrophe
    precedes text that could begin a formula.
    """
    buffer = io.StringIO()
    writer = csv.writer(
        buffer, lineterminator="\n", quoting=csv.QUOTE_NONNUMERIC if safe else csv.QUOTE_MINIMAL
    )
    for key, value in (metadata or {}).items():
        comment = f"# {key}: {printable(' '.join(_text(value).splitlines()))}"
        if safe:
            writer.writerow([comment])
        else:
            buffer.write(f"{comment}\n")
    writer.writerow([_spreadsheet_text(name) for name in names] if safe else names)
    writer.writerows(
        [[_spreadsheet_text(value) for value in row] for row in rows] if safe else rows
    )
    return buffer.getvalue()


def _spreadsheet_text(value: Any) -> Any:
    """Return a cell that a spreadsheet does not run as a formula."""
    if not isinstance(value, str):
        plain = value is None or isinstance(value, int | float | Decimal)
        return value if plain else _spreadsheet_text(str(value))
    return f"'{value}" if value.startswith(_FORMULA) else value


def json_text(names: Sequence[str], rows: Rows, metadata: Metadata | None = None) -> str:
    """Return a list of objects, or with metadata an object whose `instances` is that list.

    Raises RequestError if two columns have the same name.
    """
    _check_unique(names)
    objects = [{name: _json_value(v) for name, v in zip(names, row, strict=True)} for row in rows]
    content = objects if metadata is None else {**metadata, "instances": objects}
    return json.dumps(content, indent=1, default=str, allow_nan=False) + "\n"


def write_parquet(
    names: Sequence[str], rows: Rows, target: Path, metadata: Metadata | None = None
) -> None:
    """Write a Parquet file with `metadata` as its key-value metadata.

    Raises RequestError if two columns have the same name or the file cannot be written.
    """
    from s2rstore.files import parquet

    _check_unique(names)
    texts = {key: _text(value) for key, value in (metadata or {}).items()}
    parquet.write(target, names, rows, texts)


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, default=str)


def _json_value(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_json_value(item) for item in value]
    if isinstance(value, dict):
        return {str(key): _json_value(item) for key, item in value.items()}
    if isinstance(value, Decimal):
        value = float(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _check_unique(names: Sequence[str]) -> None:
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise RequestError(f"column {twice[0]!r} appears twice; rename one of them with AS")
