"""Run queries of the user: within limits of time and memory, or as a relation."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any

import duckdb

from s2rstore.errors import RequestError
from s2rstore.index import reading_statements
from s2rstore.security.memory_limit import bounded_memory

Rows = list[tuple[Any, ...]]

_FETCH_ROWS = 10_000
_NO_ROWS = "sql: there is no statement that returns rows; give a SELECT"
_OVERHEAD_BYTES = 100 * 10**6
"""Memory in addition to that of DuckDB: the rows as Python objects and the printed text."""


class QueryTimeoutError(RequestError):
    """The query took longer than allowed and was stopped."""


def run(
    connection: duckdb.DuckDBPyConnection, sql: str, timeout: float, memory: int
) -> tuple[list[str], Rows]:
    """Return the column names and the rows of a query.

    `timeout` is in seconds, `memory` in bytes. The query runs in another thread, so that the
    calling thread can handle ctrl+c. Raises RequestError if the query fails or has no result
    table, QueryTimeoutError at the time limit, and MemoryError at the memory limit.
    """
    with bounded_memory(memory + _OVERHEAD_BYTES), ThreadPoolExecutor(1) as pool:
        query = pool.submit(_fetch, connection, sql)
        try:
            names, rows = query.result(timeout)
        except TimeoutError:
            raise QueryTimeoutError(f"sql: stopped after {timeout:g} s") from None
        except duckdb.OutOfMemoryException as error:
            raise MemoryError from error
        except duckdb.Error as error:
            raise _request_error(error) from error
        finally:
            while not query.done():  # an interrupt between two statements has no effect
                connection.interrupt()
                wait([query], 0.05)
    if not names:
        raise RequestError(_NO_ROWS)
    return names, rows


def relation(connection: duckdb.DuckDBPyConnection, sql: str) -> duckdb.DuckDBPyRelation:
    """Return the relation of the last statement of a query, whose rows are read when they are used.

    Raises RequestError if the query fails, does more than read, or has no result table.
    """
    try:
        reading_statements.check(connection, sql)
        found = connection.sql(sql)
    except duckdb.Error as error:
        raise _request_error(error) from error
    if found is None:
        raise RequestError(_NO_ROWS)
    return found


def _request_error(error: duckdb.Error) -> RequestError:
    """The error in one line."""
    if "'pytz'" in str(error):
        return RequestError(
            "sql: a column is a time with time zone; cast it, as in now()::TIMESTAMP"
        )
    reason = str(error).split("Traceback")[0]
    return RequestError(f"sql: {' '.join(reason.split())}")


def _fetch(connection: duckdb.DuckDBPyConnection, sql: str) -> tuple[list[str], Rows]:
    reading_statements.check(connection, sql)
    result = connection.execute(sql)
    names = [column[0] for column in (result and result.description) or ()]
    rows: Rows = []
    while names and (fetched := result.fetchmany(_FETCH_ROWS)):
        rows += fetched
    return names, rows
