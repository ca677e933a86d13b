"""Write rows to a Parquet file, by DuckDB."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from decimal import Decimal
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError, first_line


def write(
    target: Path, names: Sequence[str], rows: Sequence[Sequence[Any]], metadata: Mapping[str, str]
) -> None:
    """Write a Parquet file; `metadata` becomes its key-value metadata.

    The query refers to columns by position, because their names are text of the user. Raises
    RequestError if the file cannot be written.
    """
    columns: dict[str, NDArray[Any]] = {}
    selected = []
    for number, name in enumerate(names):
        sql_type, values, present = _column([row[number] for row in rows])
        columns |= {f"v{number}": values, f"k{number}": present}
        quoted = name.replace('"', '""')
        selected.append(f'CASE WHEN k{number} THEN CAST(v{number} AS {sql_type}) END AS "{quoted}"')
    entries = ", ".join(f"{_quoted(key)}: {_quoted(text)}" for key, text in metadata.items())
    options = "FORMAT parquet" + (f", KV_METADATA {{{entries}}}" if metadata else "")
    with duckdb.connect() as connection:
        connection.register("result", columns)
        query = f"SELECT {', '.join(selected)} FROM result"
        try:
            connection.execute(f"COPY ({query}) TO {_quoted(str(target))} ({options})")
        except duckdb.Error as error:
            raise RequestError(f"{target}: cannot be written ({first_line(error)})") from error


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"


def _column(values: list[Any]) -> tuple[str, NDArray[Any], NDArray[Any]]:
    """Return the narrowest SQL type of a column, its values, and a mask of those that are set."""
    present = np.array([value is not None for value in values], dtype="bool")
    sql_type, convert, dtype, empty = _column_type([value for value in values if value is not None])
    filled = np.array([empty if value is None else convert(value) for value in values], dtype=dtype)
    return sql_type, filled, present


def _column_type(values: list[Any]) -> tuple[str, Callable[[Any], Any], str, Any]:
    """Return the SQL type, the conversion, the numpy type, and a filler for missing values."""
    if values and all(isinstance(value, bool) for value in values):
        return "BOOLEAN", bool, "bool", False
    if values and all(isinstance(v, int) and abs(v) < 2**63 for v in values):
        return "BIGINT", int, "int64", 0
    if values and all(isinstance(value, int | float | Decimal) for value in values):
        return "DOUBLE", float, "float64", 0.0
    if values and all(isinstance(value, datetime) for value in values):
        return "TIMESTAMP", lambda value: value.isoformat(), "object", "1970-01-01"
    return "VARCHAR", str, "object", ""
