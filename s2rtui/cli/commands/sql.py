"""`s2r sql`: run a query on the index; the connection is read-only and sees no other files."""

from __future__ import annotations

import argparse
import re

import s2rstore
from s2rstore.errors import RequestError
from s2rtools.common.command_line import output, store_argument

DEFAULT_TIMEOUT = 60.0
DEFAULT_MEMORY = "400MB"

_MEMORY = re.compile(r"(\d{1,6})(MB|GB)\Z")
_BYTES = {"MB": 10**6, "GB": 10**9}
EXAMPLE = 's2r sql lab.s2r "SELECT run, avg(gap_m) FROM pair GROUP BY run"'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    parser.add_argument("sql", help="SQL statement (DuckDB)")
    add = parser.add_argument_group("limits").add_argument
    add(
        "--timeout", type=float, default=DEFAULT_TIMEOUT, metavar="SECONDS",
        help=f"time after which the query is stopped (default {DEFAULT_TIMEOUT:g})",
    )  # fmt: skip
    add(
        "--memory", default=DEFAULT_MEMORY, metavar="SIZE",
        help=f"memory limit of the query and its rows, such as 2GB (default {DEFAULT_MEMORY})",
    )  # fmt: skip
    output.add_output_options(parser)


def execute(options: argparse.Namespace) -> int:
    from s2rstore.index import user_query

    size = _MEMORY.match(options.memory)
    if size is None or int(size[1]) == 0:
        raise RequestError(f"--memory {options.memory}: must be whole MB or GB, such as 2GB")
    if not 0 < options.timeout < 1e6:
        raise RequestError(f"--timeout {options.timeout:g}: must be seconds, more than 0")
    with s2rstore.open(options.store, options.memory) as store:
        memory = int(size[1]) * _BYTES[size[2]]
        try:
            names, rows = user_query.run(store.connection(), options.sql, options.timeout, memory)
        except user_query.QueryTimeoutError:
            raise RequestError(
                f"sql: the query was stopped after {options.timeout:g} s; "
                "select less, or raise --timeout"
            ) from None
        except MemoryError:
            raise RequestError(
                f"sql: the query was stopped at {options.memory} of memory; "
                "select less, or raise --memory"
            ) from None
    output.write(names, rows, options)
    return 0
