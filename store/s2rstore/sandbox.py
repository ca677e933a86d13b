"""A connection to an index that can neither write nor reach any other file.

`read_only` alone is not enough: such a connection still reads and writes other files through
table functions and COPY.
"""

from __future__ import annotations

from pathlib import Path

import duckdb

from s2rstore.errors import RequestError


def connect(index: Path) -> duckdb.DuckDBPyConnection:
    """Raises RequestError where the file is missing or no index."""
    try:
        return duckdb.connect(
            str(index),
            read_only=True,
            config={
                "enable_external_access": "false",
                "lock_configuration": "true",
                "temp_directory": "",
            },
        )
    except duckdb.Error as error:
        first_line = str(error).splitlines()[0]
        raise RequestError(f"{index}: cannot be opened ({first_line}); run `s2r verify`") from error
