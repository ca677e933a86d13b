"""Read columns of a Parquet file that came from outside: numbers, texts, lists and bytes."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError, first_line
from s2rstore.files.input_files import check_regular
from s2rstore.files.plain_paths import link
from s2rstore.index.locked_connection import connect_to_file, escaped

MAX_ROWS = 4_000_000
"""Rows that a file may have."""


def read_columns(
    path: Path, numbers: Collection[str], texts: Collection[str]
) -> dict[str, NDArray[Any]]:
    """The requested columns that a file has, in its order of rows.

    `numbers` as float64, times as seconds since 1970, NaN where there is no number; `texts` as
    objects, empty where there is none. Raises RequestError where the file cannot be read.
    """
    with _opened(path) as (connection, table):
        described = connection.execute(f"DESCRIBE SELECT * FROM {table}").fetchall()
    types = {str(name): str(kind) for name, kind, *_ in described}
    values = {
        name: _number(name, kind) if name in numbers else _text(name)
        for name, kind in types.items()
        if name in numbers or name in texts
    }
    if not values:
        return {}
    listed = ", ".join(f"{value} AS {_quoted(name)}" for name, value in values.items())
    found = _select(path, listed)
    return {
        name: np.ma.filled(found[name], np.nan) if name in numbers else np.asarray(found[name])
        for name in values
    }


def _number(name: str, kind: str) -> str:
    value = _quoted(name)
    if kind.startswith(("TIMESTAMP", "DATE")):
        value = f"epoch({value})"
    return f"TRY_CAST({value} AS DOUBLE)"


def _text(name: str) -> str:
    return f"coalesce(TRY_CAST({_quoted(name)} AS VARCHAR), '')"


def read_vectors(path: Path, column: str, elements: Sequence[int]) -> NDArray[np.float64]:
    """Elements (N, E), by number from 0, of a column of lists; NaN where there is no number.

    Raises RequestError where the file cannot be read, or has no such column.
    """
    name = _quoted(column)
    listed = ", ".join(
        f"list_extract(CAST({name} AS DOUBLE[]), {int(element) + 1}) AS v{number}"
        for number, element in enumerate(elements)
    )
    found = _select(path, listed)
    return np.column_stack([np.ma.filled(values, np.nan) for values in found.values()])


def read_blobs(path: Path, column: str, field: str, start: int, count: int) -> list[bytes]:
    """The bytes in a field of a column of records, of `count` rows from `start`; b"" for none.

    Raises RequestError where the file cannot be read, or has no such column.
    """
    value = f"struct_extract({_quoted(column)}, '{escaped(field)}') AS v"
    found = _select(path, value, f"LIMIT {int(count)} OFFSET {int(start)}")
    return [bytes(value) if isinstance(value, bytes | bytearray) else b"" for value in found["v"]]


def _select(path: Path, columns: str, rows: str = "") -> dict[str, NDArray[Any]]:
    """Columns of the file, and the clause that limits its rows."""
    with _opened(path) as (connection, table):
        query = f"SELECT {columns} FROM {table} {rows}"
        found: dict[str, NDArray[Any]] = connection.execute(query).fetchnumpy()
        return found


@contextmanager
def _opened(path: Path) -> Iterator[tuple[duckdb.DuckDBPyConnection, str]]:
    """A connection, and the function of SQL that gives the rows of the file.

    Raises RequestError for a file that cannot be read, or has more than `MAX_ROWS` rows.
    """
    check_regular(path)
    plain = escaped(str(link(path.parent, path.name)))
    table = f"read_parquet(['{plain}'], hive_partitioning = false)"
    try:
        with closing(connect_to_file(path)) as connection:
            (count,) = connection.execute(f"SELECT count(*) FROM {table}").fetchall()[0]
            if count > MAX_ROWS:
                raise RequestError(f"{path}: more than {MAX_ROWS:,} rows; split it")
            yield connection, table
    except duckdb.Error as error:
        raise RequestError(
            f"{path}: cannot be read as a Parquet file ({first_line(error)})"
        ) from error


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'
