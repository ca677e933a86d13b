"""Open a store's index at one generation: connections, queries, and rows of tables."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator
from pathlib import Path
from threading import RLock
from typing import Any

import duckdb

from s2rstore.errors import DamagedStoreError, RequestError, first_line
from s2rstore.files import layout
from s2rstore.files.store_files import StoreFiles
from s2rstore.index import locked_connection, reading_statements, row_files, schema
from s2rstore.remote.open_files import open_files
from s2rstore.security.printable_text import printable, printable_lines

_JSON = ("sim_adjustments", "real_adjustments", "shape", "axes", "source", "convention", "reasons",
         "input")  # fmt: skip
"""Columns of JSON, whose strings become printable once they are parsed."""


class OpenIndex:
    """The index of a store at one generation; any thread may read it."""

    def __init__(
        self,
        path: str | Path | StoreFiles,
        memory: str = "",
        generation: int | None = None,
        left_out: Collection[str] = (),
    ) -> None:
        """Open the published generation, or an earlier one.

        `path` is a folder or a URL. For `memory` and `left_out` see `locked_connection.connect`.
        Raises RequestError where `path` holds no store that this version can read.
        """
        self.files = open_files(path)
        self.path = self.files.path
        current = layout.current_of(self.files)
        if current.schema != schema.VERSION:
            raise RequestError(
                f"{path}: schema {current.schema}, this program reads {schema.VERSION}; "
                "use the release that wrote it, or ingest again"
            )
        self.generation = current.generation if generation is None else generation
        name = layout.index_name(self.generation)
        is_published = name == current.index
        self._index = self.files.index_file(
            name,
            current.sha256 if is_published else None,
            current.bytes if is_published else None,
        )
        self._lock = RLock()
        self._opened: duckdb.DuckDBPyConnection | None = locked_connection.connect(
            self._index, memory, left_out=left_out, place=self._place_rows
        )
        try:
            self.row_files = row_files.listed(self._opened, self._index)
            self._prepare()
        except BaseException:
            self._opened.close()
            raise

    def _prepare(self) -> None:
        """Complete the opened object: a hook for subclasses with further state or checks."""

    def _place_rows(self, file: row_files.RowFile) -> None:
        """Make sure that a file of rows lies beside the index, if the store has it."""
        self.files.local_file(f"{layout.INDEX}/{file.path}", file.sha256, file.bytes)

    def close(self) -> None:
        """Close the index."""
        with self._lock:
            opened, self._opened = self._opened, None
        if opened is not None:
            with contextlib.suppress(duckdb.Error):  # busy in another thread: closed after that
                opened.close()

    @property
    def _connection(self) -> duckdb.DuckDBPyConnection:
        if self._opened is None:
            raise RequestError(f"{self.path}: the store is closed")
        return self._opened

    def latest_generation(self) -> int:
        """The generation that is published now; this store stays at its own."""
        return layout.current_of(self.files).generation

    def connection(self) -> duckdb.DuckDBPyConnection:
        """A new read-only connection to this generation's index, for use in another thread.

        Where rows are in files, check other statements than own ones by `reading_statements`.
        """
        with self._lock:
            return self._connection.cursor()

    def execute(self, sql: str, parameters: list[Any] | None = None) -> list[tuple[Any, ...]]:
        """All rows of a query."""
        connection = self.connection()
        if self.row_files:
            reading_statements.check(connection, sql)
        with self._explained():
            return connection.execute(sql, parameters or []).fetchall()

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        """Raise DamagedStoreError where a query fails because a file of rows is not there."""
        try:
            yield
        except (duckdb.PermissionException, duckdb.IOException):
            try:
                row_files.check_present(self._index, self.row_files)
            except RequestError as error:
                raise DamagedStoreError(
                    f"{error}; if generation {self.generation} was removed, open the store again"
                ) from error
            raise

    def _rows(self, table: str) -> list[dict[str, Any]]:
        """The rows of a table, with texts in printable characters."""
        return [
            {name: _printable(name, value) for name, value in row.items()}
            for row in self._stored_rows(table)
        ]

    def _stored_rows(self, table: str) -> list[dict[str, Any]]:
        """The rows of a table in its order, as they are stored."""
        known = schema.BY_NAME[table]
        names = ", ".join(f'"{name}"' for name in known.column_names)
        query = f'SELECT {names} FROM "{table}" ORDER BY {", ".join(known.order)}'
        try:
            rows = self.execute(query)
        except duckdb.Error as error:
            message = f"{self._index}: table {table}: {first_line(error)}; run `s2r verify`"
            raise RequestError(message) from error
        return [dict(zip(known.column_names, row, strict=True)) for row in rows]


def _printable(column: str, value: Any) -> Any:
    if not isinstance(value, str):
        return value
    return printable_lines(value) if column in _JSON else printable(value)
