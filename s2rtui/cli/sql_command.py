"""`s2r sql`: a query on the index, in a connection that can neither write nor reach other files."""

from __future__ import annotations

import argparse

from s2rtui.cli import output


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store")
    parser.add_argument("sql", help="for example: SELECT run, avg(gap) FROM pair GROUP BY run")
    output.add_format(parser)


def execute(options: argparse.Namespace) -> int:
    import duckdb

    import s2rstore
    from s2rstore.errors import RequestError

    with s2rstore.open(options.store) as store:
        try:
            result = store.connection().execute(options.sql)
            if result is None or not result.description:
                raise RequestError("sql: no statement that gives rows")
            rows = result.fetchall()
            names = [column[0] for column in result.description or ()]
        except duckdb.Error as error:
            reason = str(error).split("Traceback")[0]
            raise RequestError(f"sql: {' '.join(reason.split())}") from error
    output.write(names, rows, options)
    return 0
