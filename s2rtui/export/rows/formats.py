"""Rows as CSV, JSON and Parquet; `facts` say what they are, where a format has room for that."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any

from s2rstore.errors import RequestError
from s2rstore.security.printable_text import printable

if TYPE_CHECKING:
    from numpy.typing import NDArray

_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d", "\uff0b", "\uff0d", "\uff20")
"""How a cell begins that a spreadsheet may run; the last four are the full-width signs."""
Rows = Sequence[Sequence[Any]]
Told = Mapping[str, Any]


def csv_text(
    names: Sequence[str], rows: Rows, facts: Told | None = None, safe: bool = False
) -> str:
    """A line of names, then the rows; before them a `# key: value` line per fact.

    `safe` text runs as a formula in no spreadsheet: every text is quoted, and begins with an
    apostrophe where a formula could begin.
    """
    buffer = io.StringIO()
    writer = csv.writer(
        buffer,
        lineterminator="\n",
        quoting=csv.QUOTE_NONNUMERIC if safe else csv.QUOTE_MINIMAL,
    )
    for key, value in (facts or {}).items():
        fact = f"# {key}: {printable(' '.join(_text(value).splitlines()))}"
        if safe:
            writer.writerow([fact])
        else:
            buffer.write(f"{fact}\n")
    writer.writerow([_literal(name) for name in names] if safe else names)
    writer.writerows([[_literal(value) for value in row] for row in rows] if safe else rows)
    return buffer.getvalue()


def _literal(value: Any) -> Any:
    """A cell that a spreadsheet takes as text, where it is text."""
    if not isinstance(value, str):
        plain = value is None or isinstance(value, int | float | Decimal)
        return value if plain else _literal(str(value))
    return f"'{value}" if value.startswith(_FORMULA) else value


def json_text(names: Sequence[str], rows: Rows, facts: Told | None = None) -> str:
    """A list of objects; with facts an object of them whose `instances` is that list.

    Raises RequestError where two columns have one name.
    """
    _distinct(names)
    listed = [{name: _plain(v) for name, v in zip(names, row, strict=True)} for row in rows]
    whole = listed if facts is None else {**facts, "instances": listed}
    return json.dumps(whole, indent=1, default=str, allow_nan=False) + "\n"


def save(
    target: Path,
    names: Sequence[str],
    rows: Rows,
    facts: Told | None = None,
    safe_csv: bool = False,
) -> None:
    """Write a file in the format that its end names. Raises RequestError, OSError."""
    if target.suffix == ".parquet":
        write_parquet(names, rows, target, facts)
    else:
        is_csv = target.suffix == ".csv"
        text = csv_text(names, rows, facts, safe_csv) if is_csv else json_text(names, rows, facts)
        target.write_text(text, encoding="utf-8")


def write_parquet(
    names: Sequence[str], rows: Rows, target: Path, facts: Told | None = None
) -> None:
    """Columns go in by position, because their names are the user's text; facts as metadata.

    Raises RequestError where two columns have one name, or the file cannot be written.
    """
    import duckdb

    _distinct(names)
    columns: dict[str, NDArray[Any]] = {}
    selected = []
    for number, name in enumerate(names):
        kind, values, known = _column([row[number] for row in rows])
        columns |= {f"v{number}": values, f"k{number}": known}
        quoted = name.replace('"', '""')
        selected.append(f'CASE WHEN k{number} THEN CAST(v{number} AS {kind}) END AS "{quoted}"')
    options = "FORMAT parquet" + (f", KV_METADATA {{{_metadata(facts)}}}" if facts else "")
    with duckdb.connect() as connection:
        connection.register("result", columns)
        query = f"SELECT {', '.join(selected)} FROM result"
        try:
            connection.execute(f"COPY ({query}) TO {_quoted(str(target))} ({options})")
        except duckdb.Error as error:
            reason = str(error).splitlines()[0]
            raise RequestError(f"{target}: cannot be written ({reason})") from error


def _metadata(facts: Told) -> str:
    return ", ".join(f"{_quoted(key)}: {_quoted(_text(value))}" for key, value in facts.items())


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, default=str)


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


def _column(values: list[Any]) -> tuple[str, NDArray[Any], NDArray[Any]]:
    """The narrowest type that holds a column, its values, and which of them are there."""
    import numpy as np

    known = np.array([value is not None for value in values], dtype="bool")
    kind, make, dtype, empty = _type([value for value in values if value is not None])
    held = np.array([empty if value is None else make(value) for value in values], dtype=dtype)
    return kind, held, known


def _type(values: list[Any]) -> tuple[str, Callable[[Any], Any], str, Any]:
    """SQL type, what brings values there, the array's type, and what stands for no value."""
    if values and all(isinstance(value, bool) for value in values):
        return "BOOLEAN", bool, "bool", False
    if values and all(isinstance(v, int) and abs(v) < 2**63 for v in values):
        return "BIGINT", int, "int64", 0
    if values and all(isinstance(value, int | float | Decimal) for value in values):
        return "DOUBLE", float, "float64", 0.0
    if values and all(isinstance(value, datetime) for value in values):
        return "TIMESTAMP", lambda value: value.isoformat(), "object", "1970-01-01"
    return "VARCHAR", str, "object", ""
