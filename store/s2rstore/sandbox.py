"""A connection to an index that can neither write nor reach any other file.

`read_only` alone is not enough: such a connection still reads and writes other files through
table functions and COPY.
"""

from __future__ import annotations

import threading
from pathlib import Path

import duckdb

from s2rstore.errors import RequestError

_locking = threading.Lock()
"""Connections of one process to one file share a configuration, which can be locked once."""


def connect(index: Path, memory: str = "") -> duckdb.DuckDBPyConnection:
    """A connection whose configuration is locked.

    `memory`, as DuckDB writes it (128MB), bounds what it holds of the file and what queries may
    take; the first to open a file in a process decides. Raises RequestError where the file is
    missing or no index.
    """
    try:
        connection = duckdb.connect(
            str(index),
            read_only=True,
            config={"enable_external_access": "false", "temp_directory": ""},
        )
        with _locking:
            locked = connection.execute("SELECT current_setting('lock_configuration')").fetchone()
            if locked != (True,):
                if memory:
                    connection.execute(f"SET memory_limit = '{memory}'")
                connection.execute("SET lock_configuration = true")
        return connection
    except duckdb.Error as error:
        first_line = str(error).splitlines()[0]
        raise RequestError(f"{index}: cannot be opened ({first_line}); run `s2r verify`") from error
