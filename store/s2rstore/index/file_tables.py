"""The tables of an unpublished index whose rows are in files."""

from __future__ import annotations

import os
import secrets
from collections.abc import Mapping
from pathlib import Path

import duckdb

from s2rstore.errors import RequestError, first_line
from s2rstore.files import atomic_writes, layout, plain_paths, safe_files
from s2rstore.index import locked_connection, pair_view, row_files, schema
from s2rstore.index.row_files import PARTITIONS, RowFile, RowFiles
from s2rstore.index.table_definition import comments_on, statements_of

_CHANGED = 'memory.main."{}"'


class FileTables:
    """Tables with files: unchanged files stay listed, rows that an edit changes are in memory.

    Until `write`, such a table is a temporary view over both. Files that hold rows of an update or
    of a deletion by other columns than the run are read into memory first.
    """

    def __init__(self, connection: duckdb.DuckDBPyConnection, root: Path) -> None:
        self._connection = connection
        self._root = root
        self._folder = (root / layout.INDEX).absolute()
        self._kept: dict[str, list[RowFile]] = {}
        self._partial: list[str] = []
        self._written: dict[str, RowFile] = {}

    def take_over(self, files: RowFiles) -> None:
        """Keep the files of the present generation."""
        self._kept = {table: list(group) for table, group in files.items()}
        for file in (file for group in files.values() for file in group):
            plain_paths.link(self._folder, file.path)

    @property
    def names(self) -> list[str]:
        """The tables that are not in the index."""
        return list(self._kept)

    def begin(self) -> None:
        """Make the temporary views; the other tables of the index must exist."""
        for table in self._kept:
            columns = ", ".join(f'"{c.name}" {c.type}' for c in schema.BY_NAME[table].columns)
            self._connection.execute(f"CREATE TABLE {self.target(table)} ({columns})")
            self._show(table)
        if self._kept:
            self._connection.execute(pair_view.temporary_view_statement())

    def target(self, table: str) -> str:
        """The name of the table, for SQL, that takes rows of `table`."""
        return _CHANGED.format(table) if table in self._kept else f'"{table}"'

    def forget(self, table: str, where: Mapping[str, str]) -> None:
        """Before rows are deleted: drop the files that hold such rows alone, load the others."""
        if table not in self._kept:
            return
        if set(where) <= {PARTITIONS[table]}:
            self._take(table, where)
        else:
            self.load(table, where)

    def load(self, table: str, where: Mapping[str, str]) -> None:
        """Read the files that may hold such rows into memory, because the rows will change."""
        if table not in self._kept:
            return
        taken = self._take(table, where)
        if taken:
            rows = row_files.select(table, taken, self._folder)
            self._connection.execute(f"INSERT INTO {self.target(table)} {rows}")

    def _take(self, table: str, where: Mapping[str, str]) -> list[RowFile]:
        """The files that may hold rows of the given values, which are listed no longer."""
        partition = PARTITIONS[table]
        value = where.get(partition) if partition else None
        taken = [file for file in self._kept[table] if value is None or file.run == value]
        self._kept[table] = [file for file in self._kept[table] if file not in taken]
        self._show(table)
        return taken

    def _show(self, table: str) -> None:
        rows = f"SELECT * FROM {self.target(table)}"
        if self._kept[table]:
            files = row_files.select(table, self._kept[table], self._folder)
            rows = f"{files} UNION ALL {rows}"
        self._connection.execute(f'CREATE OR REPLACE TEMP VIEW "{table}" AS {rows}')

    def move_large_tables(self) -> list[str]:
        """Write the rows of tables in the index that have become too large, and name these."""
        moved = []
        for table in PARTITIONS:
            if table not in self._kept and self._count(f'"{table}"') > row_files.MAX_ROWS:
                self._write_rows(table, f'"{table}"')
                moved.append(table)
        return moved

    def write(self) -> None:
        """Write the rows in memory to files, one per run; they are not in place before `finish`."""
        for table in self._kept:
            runs = {file.run for file in self._kept[table]}
            for (run,) in self._runs(table, self.target(table)):
                if run is not None and run in runs:  # added to those of a file
                    self.load(table, {"run": run})
            self._write_rows(table, self.target(table))

    def _runs(self, table: str, source: str) -> list[tuple[str | None]]:
        """The runs with rows in `source`; one None for a table without runs."""
        if PARTITIONS[table] is None:
            return [(None,)] if self._count(source) else []
        query = f"SELECT DISTINCT run FROM {source} ORDER BY run"
        return self._connection.execute(query).fetchall()

    def _count(self, source: str) -> int:
        ((count,),) = self._connection.execute(f"SELECT count(*) FROM {source}").fetchall()
        return int(count)

    def _write_rows(self, table: str, source: str) -> None:
        for (run,) in self._runs(table, source):
            if PARTITIONS[table] is not None:
                if run is None:
                    raise RequestError(f"{self._root}: table {table}: rows without a run")
                layout.checked_name(run, "run")
            self._write_file(table, run, source)

    def _write_file(self, table: str, run: str | None, source: str) -> None:
        columns = [c.name for c in schema.BY_NAME[table].columns if c.name != PARTITIONS[table]]
        names = ", ".join(f'"{name}"' for name in columns)
        condition = "true" if run is None else f"run = '{run}'"
        folder = "/".join(filter(None, (layout.INDEX, row_files.FOLDER, table, run)))
        atomic_writes.make_folder(self._root, folder)
        partial = f"{folder}/.{secrets.token_hex(8)}{atomic_writes.PARTIAL}"
        safe_files.checked_path(self._root, partial)
        plain = plain_paths.plain_path(self._folder, partial.removeprefix(f"{layout.INDEX}/"))
        plain_paths.make_parent(plain)
        path = locked_connection.escaped(str(plain))
        self._partial.append(partial)
        ((rows,),) = self._connection.execute(
            f"COPY (SELECT {names} FROM {source} WHERE {condition}) TO '{path}' "
            "(FORMAT parquet, USE_TMP_FILE false)"
        ).fetchall()
        plain_paths.move_back(plain, self._root, partial)
        atomic_writes.sync(self._root, partial)
        sha256 = safe_files.sha256(self._root, partial)
        size = safe_files.size(self._root, partial)
        name = row_files.path_of(table, run, sha256)
        self._written[partial] = RowFile(table, run, name, sha256, size, int(rows))

    def _place(self) -> None:
        """Give the new files their names, durably; a file of the same content stays as it is."""
        folders: set[str] = set()
        for partial, file in self._written.items():
            name = f"{layout.INDEX}/{file.path}"
            if not self._holds(name, file):
                atomic_writes.rename(self._root, partial, name)
                folders.update(parent.as_posix() for parent in Path(name).parents)
            kept = self._kept.setdefault(file.table, [])
            if any(other.path == file.path for other in kept):
                raise RequestError(f"{self._root}: table {file.table}: rows that it has already")
            kept.append(file)
            plain_paths.link(self._folder, file.path)
        for folder in folders - {"."}:
            with safe_files.folder(self._root, folder) as descriptor:
                os.fsync(descriptor)

    def _holds(self, name: str, file: RowFile) -> bool:
        try:
            return safe_files.sha256(self._root, name) == file.sha256
        except FileNotFoundError:
            return False

    def finish(self) -> None:
        """Put the new files in their places, and list and view all files in the current database.

        A table without files becomes an empty one.
        """
        self._place()
        if not self._kept:
            return
        for table in ("pair", *self._kept):
            self._connection.execute(f'DROP VIEW IF EXISTS temp.main."{table}"')
        made: list[str] = []
        for table, files in self._kept.items():
            known = schema.BY_NAME[table]
            files.sort(key=lambda file: (file.run or "", file.path))  # as `row_files.listed`
            if files:
                made += [row_files.view(table, files), *comments_on(known, "VIEW")]
            else:
                made += statements_of(known)
        try:
            locked_connection.run_at_once(self._connection, [*made, *pair_view.statements()])
        except duckdb.Error as error:
            raise RequestError(
                f"{self._folder}: files of rows cannot be read ({first_line(error)}); run "
                "`s2r verify`, or start the command in another folder"
            ) from error
        filed = [table for table, files in self._kept.items() if files]
        row_files.check_types(self._connection, filed, self._folder)
        values = [
            (file.table, file.run, file.path, file.sha256, file.bytes, file.rows)
            for files in self._kept.values()
            for file in files
        ]
        if values:
            query = f"INSERT INTO {row_files.TABLE} VALUES (?, ?, ?, ?, ?, ?)"
            self._connection.executemany(query, values)

    def remove_partial(self) -> None:
        """Remove the new files that have not got their names."""
        for partial in self._partial:
            atomic_writes.remove(self._root, partial)
