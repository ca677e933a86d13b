"""`s2r sql`: run a query on the index; the connection is read-only and sees no other files."""

from __future__ import annotations

import argparse
import re
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any

from s2rtui.cli.formatting import rows as output

if TYPE_CHECKING:
    import duckdb

Rows = list[tuple[Any, ...]]

DEFAULT_TIMEOUT = 60.0
DEFAULT_MEMORY = "400MB"

_MEMORY = re.compile(r"(\d{1,6})(MB|GB)\Z")
_BYTES = {"MB": 10**6, "GB": 10**9}
_FETCH_ROWS = 10_000
_OVERHEAD_BYTES = 100 * 10**6
"""Memory beside that of DuckDB: the rows as Python objects and the printed text."""


EXAMPLE = 's2r sql lab.s2r "SELECT run, avg(gap) FROM pair GROUP BY run"'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", help="store folder")
    parser.add_argument("sql", help="SQL statement (DuckDB)")
    limits = parser.add_argument_group("limits")
    limits.add_argument(
        "--timeout", type=float, default=DEFAULT_TIMEOUT, metavar="SECONDS",
        help=f"time after which the query is stopped (default {DEFAULT_TIMEOUT:g})",
    )  # fmt: skip
    limits.add_argument(
        "--memory", default=DEFAULT_MEMORY, metavar="SIZE",
        help=f"memory limit of the query and its rows, such as 2GB (default {DEFAULT_MEMORY})",
    )  # fmt: skip
    output.add_output_options(parser)


def execute(options: argparse.Namespace) -> int:
    import s2rstore
    from s2rstore.errors import RequestError

    size = _MEMORY.match(options.memory)
    if size is None or int(size[1]) == 0:
        raise RequestError(f"--memory {options.memory}: must be whole MB or GB, such as 2GB")
    if not 0 < options.timeout < 1e6:
        raise RequestError(f"--timeout {options.timeout:g}: must be seconds, more than 0")
    with s2rstore.open(Path(options.store), options.memory) as store:
        names, rows = _run(store.connection(), options, int(size[1]) * _BYTES[size[2]])
    output.write(names, rows, options)
    return 0


def _run(
    connection: duckdb.DuckDBPyConnection, options: argparse.Namespace, memory: int
) -> tuple[list[str], Rows]:
    """Return column names and rows. Raises RequestError if the query fails or reaches a limit.

    The query runs in another thread, so that this one can handle ctrl+c.
    """
    import duckdb

    from s2rstore.errors import RequestError
    from s2rstore.security.memory_limit import bounded_memory

    with bounded_memory(memory + _OVERHEAD_BYTES), ThreadPoolExecutor(1) as pool:
        query = pool.submit(_fetch, connection, options.sql)
        try:
            names, rows = query.result(options.timeout)
        except TimeoutError:
            raise RequestError(
                f"sql: the query was stopped after {options.timeout:g} s; "
                "select less, or raise --timeout"
            ) from None
        except (MemoryError, duckdb.OutOfMemoryException):
            raise RequestError(
                f"sql: the query was stopped at {options.memory} of memory; "
                "select less, or raise --memory"
            ) from None
        except duckdb.Error as error:
            reason = str(error).split("Traceback")[0]
            raise RequestError(f"sql: {' '.join(reason.split())}") from error
        finally:
            while not query.done():  # an interrupt between two statements has no effect
                connection.interrupt()
                wait([query], 0.05)
    if not names:
        raise RequestError("sql: there is no statement that returns rows; give a SELECT")
    return names, rows


def _fetch(connection: duckdb.DuckDBPyConnection, sql: str) -> tuple[list[str], Rows]:
    result = connection.execute(sql)
    if result is None:
        return [], []
    names = [column[0] for column in result.description or ()]
    rows: Rows = []
    while names and (fetched := result.fetchmany(_FETCH_ROWS)):
        rows += fetched
    return names, rows
