"""Write the history of nightly gaps.

A copy is changed and then replaces the file, so that readers never see a partial change.
"""

from __future__ import annotations

import datetime
import math
import secrets
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import duckdb

from s2rstore.errors import RequestError, first_line
from s2rstore.files import atomic_writes
from s2rstore.files.plain_paths import plain_path
from s2rstore.gap_history import reader, schema
from s2rstore.index import locked_connection
from s2rstore.index.table_definition import Table

Check = Callable[[], None]
Change = Callable[[duckdb.DuckDBPyConnection], None]
Rows = dict[str, list[dict[str, Any]]]
"""Rows to add, by table; each row maps column names to values."""


def append(path: Path, added: Rows, check: Check = lambda: None) -> None:
    """Add rows durably, all or none. Raises RequestError on failure.

    The caller holds the lock; `check` of its lease is called directly before the file is replaced.
    """
    _replace(path, partial(_add, added), check)


def withdraw_night(
    path: Path, name: str, night: datetime.date, now: str, check: Check = lambda: None
) -> None:
    """Move the rows of a night to the tables of withdrawn nights, all or none, as in `append`."""
    _replace(path, partial(_withdraw, name, night, now), check)


def _replace(path: Path, change: Change, check: Check) -> None:
    reader.refuse_link(path)
    beside = path.with_name(f".{path.name}.{secrets.token_hex(8)}.new")
    try:
        for left in path.parent.glob(f".{path.name}.*.new*"):
            left.unlink(missing_ok=True)
        _write(beside, path if path.exists() else None, change)
        beside.chmod(0o644)
        atomic_writes.sync_path(beside)
        check()
        beside.replace(path)
        atomic_writes.sync_path(path.parent)
    except (OSError, duckdb.Error) as error:
        raise RequestError(f"{path}: cannot be written ({first_line(error)})") from error
    finally:
        for name in (beside, beside.with_name(f"{beside.name}.wal")):
            with suppress(OSError):
                name.unlink(missing_ok=True)


def _write(path: Path, base: Path | None, change: Change) -> None:
    """Write a new file: copy all rows of `base`, apply `change`, create the views again."""
    connection = locked_connection.connect_empty([plain_path(path.parent, path.name).parent])
    try:
        locked_connection.attach_new(connection, path, "history", schema.statements())
        if base is not None:
            locked_connection.attach_read_only(
                connection, base, "base", schema.TABLES, schema.VIEWS
            )
            for table in schema.TABLES:
                names = ", ".join(f'"{column}"' for column in table.column_names)
                rows = f'SELECT {names} FROM base."{table.name}"'
                connection.execute(f'INSERT INTO history."{table.name}" ({names}) {rows}')
            connection.execute("DETACH base")
        change(connection)
        locked_connection.detach_new(connection, path, "history")
    finally:
        connection.close()


def _add(added: Rows, connection: duckdb.DuckDBPyConnection) -> None:
    """Insert rows; numbers that are not finite become NULL."""
    for table, rows in added.items():
        for row in rows:
            names = ", ".join(f'"{name}"' for name in row)
            marks = ", ".join("?" for _ in row)
            values = [
                None if isinstance(value, float) and not math.isfinite(value) else value
                for value in row.values()
            ]
            connection.execute(f'INSERT INTO "{table}" ({names}) VALUES ({marks})', values)


def _withdraw(
    name: str, night: datetime.date, now: str, connection: duckdb.DuckDBPyConnection
) -> None:
    pairs: tuple[tuple[str, Table, dict[str, str]], ...] = (
        ("night", schema.WITHDRAWN, {"withdrawn_at": now}),
        ("recorded", schema.WITHDRAWN_RECORDED, {}),
    )
    for source, target, added in pairs:
        names = ", ".join(f'"{each}"' for each in target.column_names if each not in added)
        values = "".join(", ?" for _ in added)
        connection.execute(
            f"INSERT INTO {target.name} SELECT {names}{values} FROM {source} "
            "WHERE name = ? AND night = ?",
            [*added.values(), name, night],
        )
        connection.execute(f"DELETE FROM {source} WHERE name = ? AND night = ?", [name, night])
