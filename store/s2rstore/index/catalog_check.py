"""Comparing the catalog of a DuckDB file with the tables and views that this program makes.

A macro called `sqrt` would replace the function of that name in every query on the file, and a
view called `instance` could read other files or never end. So a file may hold the known tables as
base tables, the known views with the known definition, other tables, and nothing else. In place of
a table whose rows are in files there must be the view that follows from the list of these files.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import duckdb

from s2rstore.errors import RequestError, first_line
from s2rstore.index import row_files
from s2rstore.index.row_files import RowFiles
from s2rstore.index.table_definition import Table
from s2rstore.lru_cache import LruCache

# Objects of a database that can hold code or change what names mean. Macros come first: nothing
# else may be queried before it is known that no function was replaced.
_MACROS = "SELECT function_name FROM system.main.duckdb_functions() WHERE NOT internal"
_OTHERS = """
    SELECT 'type', type_name FROM duckdb_types() WHERE NOT internal
    UNION ALL SELECT 'sequence', sequence_name FROM duckdb_sequences()
    UNION ALL SELECT 'index', index_name FROM duckdb_indexes()
    UNION ALL SELECT 'schema', schema_name FROM duckdb_schemas() WHERE NOT internal
"""
_VIEWS = "SELECT view_name, sql FROM duckdb_views() WHERE NOT internal AND database_name = ?"
_COLUMNS = """
    SELECT table_name, column_name, data_type, column_default FROM duckdb_columns()
    WHERE NOT internal AND database_name = ? AND table_name IN
        (SELECT table_name FROM duckdb_tables() WHERE database_name = ?)
"""
_COUNTS = "SELECT table_name, estimated_size FROM duckdb_tables() WHERE database_name = ?"
_VIEW = re.compile(r"\s*CREATE VIEW (\w+) AS\s+(.*?)[\s;]*\Z", re.DOTALL)
_POSITIONS = re.compile(r'"query_location(_length)?":\d+,?')
_trees = LruCache(4 * 2**20, size=len)
"""Parsed SELECTs by their text: the views of all stores have nearly the same."""


def check(
    connection: duckdb.DuckDBPyConnection,
    tables: Sequence[Table],
    views: Sequence[str],
    path: Path,
    database: str | None = None,
) -> None:
    """Raise RequestError where the catalog of `database` differs from what `path` should hold.

    `views` are the statements that may have made its views. The database is the connection's own
    unless another one, which was attached, is named.
    """
    try:
        for (name,) in connection.execute(_MACROS).fetchall():
            raise _refusal(path, f"macro {name!r}")
        for what, name in connection.execute(_OTHERS).fetchall():
            raise _refusal(path, f"{what} {name!r}")
        if database is None:
            (database,) = connection.execute("SELECT current_database()").fetchall()[0]
        columns = _table_columns(connection, database)
        files: RowFiles = {}
        for known in tables:
            if known.name == row_files.TABLE and known.name in columns:
                _check_table(known, columns, path)
                files = row_files.listed(connection, path, database)
        _check_views(connection, views, files, path, database)
        for known in tables:
            if known.name not in files:
                _check_table(known, columns, path)
        _check_counts(connection, path, database)
    except duckdb.Error as error:
        message = f"{path}: unreadable catalog ({first_line(error)}); run `s2r verify`"
        raise RequestError(message) from error


def _refusal(path: Path, what: str) -> RequestError:
    return RequestError(
        f"{path}: holds the {what}, which this program never writes; do not use this file"
    )


def _check_views(
    connection: duckdb.DuckDBPyConnection,
    views: Sequence[str],
    files: RowFiles,
    path: Path,
    database: str,
) -> None:
    present = dict(connection.execute(_VIEWS, [database]).fetchall())
    known: dict[str, list[str]] = {}
    over_files = (row_files.view(table, files[table]) for table in files)
    for statement in (*views, *over_files):
        known.setdefault(_parts(statement)[0], []).append(_tree(connection, statement))
    for name, sql in present.items():
        if name not in known:
            raise _refusal(path, f"view {name!r}")
        if _parts(sql)[0] != name or _tree(connection, sql) not in known[name]:
            raise _refusal(path, f"view {name!r} with another definition")
    for table in files:
        if table not in present:
            raise RequestError(f"{path}: no view {table} of its files; run `s2r verify`")


def _parts(statement: str) -> tuple[str, str]:
    """Split `CREATE VIEW name AS select` into name and select; empty texts if it differs."""
    match = _VIEW.match(statement)
    return (match[1], match[2]) if match else ("", "")


def _tree(connection: duckdb.DuckDBPyConnection, statement: str) -> str:
    """The parsed SELECT of a view, without the positions of its words."""
    select = _parts(statement)[1]

    def parsed() -> str:
        query = "SELECT json_serialize_sql(?::VARCHAR)"
        (tree,) = connection.execute(query, [select]).fetchall()[0]
        return _POSITIONS.sub("", tree)

    return _trees.get(select, parsed)


def _table_columns(
    connection: duckdb.DuckDBPyConnection, database: str
) -> dict[str, dict[str, tuple[str, str | None]]]:
    """Type and default of every column of every base table."""
    present: dict[str, dict[str, tuple[str, str | None]]] = {}
    for table, column, kind, default in connection.execute(_COLUMNS, [database] * 2).fetchall():
        present.setdefault(table, {})[column] = (kind, default)
    return present


def _check_table(
    known: Table, present: dict[str, dict[str, tuple[str, str | None]]], path: Path
) -> None:
    if known.name not in present:
        raise RequestError(f"{path}: no table {known.name}; run `s2r verify`")
    for expected in known.columns:
        kind, default = present[known.name].get(expected.name, ("", None))
        if kind != expected.type or default is not None:
            has = f"{kind} {default or ''}".strip() or "missing"
            raise RequestError(
                f"{path}: table {known.name}: column {expected.name} is {has}, "
                f"expected {expected.type}; run `s2r verify`"
            )


def _check_counts(connection: duckdb.DuckDBPyConnection, path: Path, database: str) -> None:
    """Tables of repeated rows would take far more memory than the size of the file."""
    size = path.stat().st_size
    for table, rows in connection.execute(_COUNTS, [database]).fetchall():
        if rows > row_files.MAX_ROWS_PER_BYTE * size:
            raise RequestError(f"{path}: table {table}: {rows} rows in {size} bytes")
