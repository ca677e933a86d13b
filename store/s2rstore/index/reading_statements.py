"""Recognize the SQL statements that only read.

A connection to an index with files of rows may open these files and the index, and DuckDB has no
permission to read alone: `COPY ... TO` would write them.
"""

from __future__ import annotations

import re

import duckdb

_ALWAYS = (duckdb.StatementType.SELECT,)
_WITHOUT_COPY = (
    duckdb.StatementType.EXPLAIN, duckdb.StatementType.MULTI, duckdb.StatementType.PRAGMA,
)  # fmt: skip
"""EXPLAIN ANALYZE runs its statement, and PIVOT, which makes several, can stand inside a COPY."""
_COPY = re.compile(r"copy|export|attach", re.IGNORECASE)


def check(connection: duckdb.DuckDBPyConnection, sql: str) -> None:
    """Raise duckdb.PermissionException unless every statement of `sql` only reads.

    A text that DuckDB cannot parse raises duckdb.ParserException.
    """
    for statement in connection.extract_statements(sql):
        if statement.type in _ALWAYS:
            continue
        if statement.type not in _WITHOUT_COPY or _COPY.search(statement.query):
            raise duckdb.PermissionException("only statements that read are possible: SELECT")
