"""Connections to DuckDB files that came from outside.

Such a file can hold views, macros and a write-ahead log of unknown origin, and a connection that is
only `read_only` still reads and writes other files. Every connection of this module has external
access off and its configuration locked before the first statement, and nothing is read from a file
before its catalog is compared with the known tables (`catalog_check`).

An index whose rows are in files (`row_files`) is read by a database in memory, which may open the
index and exactly these files. Its views stand for the tables of the index.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import suppress
from pathlib import Path

import duckdb

from s2rstore.errors import RequestError, first_line
from s2rstore.files import plain_paths, safe_files
from s2rstore.index import catalog_check, catalog_check_cache, pair_view, row_files, schema
from s2rstore.index.row_files import RowFile, RowFiles
from s2rstore.index.table_definition import Table
from s2rstore.lru_cache import LruCache

DEFAULT_MEMORY = "2GB"
"""Memory limit of DuckDB for one file and its queries."""

_CLOSED: dict[str, str | bool | int | float | list[str]] = {
    "enable_external_access": "false",
    "temp_directory": "",
}
_CLOSED_SETTINGS = ("temp_directory = ''", "enable_external_access = false")
_SETTINGS = {
    "autoinstall_known_extensions": "false",
    "autoload_known_extensions": "false",
    "threads": str(min(8, os.cpu_count() or 1)),
}
_opening = threading.Lock()
"""Connections of one process to one file share a configuration, which is locked once."""
_checked: dict[tuple[int, ...], None] = {}
"""Identities of the files whose catalog passed the check, or that this process has made.

A published file never changes.
"""
_filled = LruCache(16 << 20, size=len)
"""New files by the statements that filled them: making the tables takes ten times as long."""
_compared: dict[tuple[int, ...], None] = {}
"""Identities of the indexes whose files of rows hold the columns and rows that they should."""


def connect(
    path: Path,
    memory: str = "",
    tables: Sequence[Table] = schema.TABLES,
    views: Sequence[str] = pair_view.VIEWS,
    with_row_files: bool = True,
    left_out: Collection[str] = (),
    place: Callable[[RowFile], None] = lambda file: None,
) -> duckdb.DuckDBPyConnection:
    """A locked read-only connection to a file that holds `tables`, `views` and no other code.

    `memory`, in DuckDB's notation (128MB), limits its cache of the file and the memory of queries;
    the first connection of a process to a file decides. Without `with_row_files`, tables whose rows
    are in files cannot be read, and these files may be missing. The rows of the files `left_out`,
    by their paths relative to the index, are missing from their tables. `place` is called for the
    other ones before they are opened, to bring them beside the index. Where there are files of
    rows, callers must check that statements only read (`reading_statements`). Raises RequestError
    where the file or a file of rows is missing, is not a database, or does not hold the expected
    tables and views.
    """
    require_regular(path)
    try:
        connection = duckdb.connect(_link(path), read_only=True, config=_CLOSED)
        with _opening:
            _lock(connection, memory or DEFAULT_MEMORY)
    except duckdb.Error as error:
        message = f"{path}: cannot be opened ({first_line(error)}); run `s2r verify`"
        raise RequestError(message) from error
    try:
        _check(connection, tables, views, path)
        files = row_files.listed(connection, path) if with_row_files else {}
    except BaseException:
        connection.close()
        raise
    if not files:
        return connection
    stored = connection.execute("SELECT table_name FROM duckdb_tables()").fetchall()
    connection.close()
    present = {
        table: [file for file in group if file.path not in left_out]
        for table, group in files.items()
    }
    for file in (file for group in present.values() for file in group):
        place(file)
    return _connect_with_files(path, memory, [name for (name,) in stored], present, views)


def _connect_with_files(
    path: Path, memory: str, tables: Sequence[str], files: RowFiles, views: Sequence[str]
) -> duckdb.DuckDBPyConnection:
    """A database in memory with a view on every table of an index, and on its files of rows."""
    row_files.check_present(path, files)
    index = _link(path)
    every = [file for group in files.values() for file in group]
    paths = [str(plain_paths.link(path.parent, file.path)) for file in every]
    allowed = ", ".join(f"'{escaped(text)}'" for text in (index, f"{index}.wal", *paths))
    connection = duckdb.connect()
    try:
        for setting in (f"allowed_paths = [{allowed}]", *_CLOSED_SETTINGS):
            connection.execute(f"SET {setting}")
        _lock(connection, memory or DEFAULT_MEMORY)
        connection.execute(f"ATTACH '{escaped(index)}' AS stored (READ_ONLY)")
        for table in tables:
            name = table.replace('"', '""')
            connection.execute(f'CREATE VIEW "{name}" AS SELECT * FROM stored."{name}"')
        for table in files:
            connection.execute(row_files.view(table, files[table], path.parent))
        connection.execute(views[0])
        row_files.check_types(connection, files, path)
        identity = *_identity(path), hash(tuple(paths))
        if identity not in _compared:
            row_files.check_files(connection, path, files)
            _compared[identity] = None
    except duckdb.Error as error:
        connection.close()
        message = f"{path}: cannot be opened ({first_line(error)}); run `s2r verify`"
        raise RequestError(message) from error
    except BaseException:
        connection.close()
        raise
    return connection


def connect_empty(
    folders: Sequence[Path], search_folder: Path | None = None
) -> duckdb.DuckDBPyConnection:
    """A locked connection to an empty database that can attach files in `folders` alone.

    It can make views over files of rows by their paths relative to `search_folder`.
    """
    connection = duckdb.connect()
    allowed = [str(plain_paths.plain_path(folder)) for folder in folders]
    if search_folder is not None:
        # DuckDB checks a relative path as one in the working folder, before it searches for it.
        with suppress(FileNotFoundError):  # a working folder that was removed
            allowed.append(os.path.abspath(row_files.FOLDER))
        search = str(plain_paths.plain_path(search_folder))
        connection.execute(f"SET file_search_path = '{escaped(search)}'")
    listed = ", ".join(f"'{escaped(folder)}'" for folder in allowed)
    connection.execute(f"SET allowed_directories = [{listed}]")
    for setting in _CLOSED_SETTINGS:
        connection.execute(f"SET {setting}")
    _lock(connection, DEFAULT_MEMORY)
    return connection


def connect_to_file(path: Path) -> duckdb.DuckDBPyConnection:
    """A locked connection to an empty database that can read one file, by its absolute path."""
    safe_files.checked_path(path.parent, path.name)
    connection = duckdb.connect()
    connection.execute(f"SET allowed_paths = ['{escaped(_link(path))}']")
    for setting in _CLOSED_SETTINGS:
        connection.execute(f"SET {setting}")
    _lock(connection, DEFAULT_MEMORY)
    return connection


def attach_read_only(connection: duckdb.DuckDBPyConnection, path: Path, name: str) -> None:
    """Attach an index of a folder that the connection may reach, and check its catalog."""
    require_regular(path)
    connection.execute(f"ATTACH '{escaped(_link(path))}' AS {name} (READ_ONLY)")
    _check(connection, schema.TABLES, pair_view.VIEWS, path, name)


def attach_new(
    connection: duckdb.DuckDBPyConnection, path: Path, name: str, statements: Sequence[str]
) -> None:
    """Attach a new file, make it the current database and fill it by SQL statements.

    The file may get its place only when it is detached, see `plain_paths`.
    """
    plain = plain_paths.plain_path(path.parent, path.name)
    plain_paths.make_parent(plain)
    attach = (
        f"ATTACH '{escaped(str(plain))}' AS {name} (STORAGE_VERSION '{schema.STORAGE_VERSION}')"
    )

    def made() -> bytes:
        for statement in (attach, f"USE {name}"):
            connection.execute(statement)
        run_at_once(connection, statements)
        _detach(connection, name)
        content = plain.read_bytes()
        plain.unlink()
        return content

    content = _filled.get(tuple(statements), made)
    with plain.open("xb") as file:
        file.write(content)
    for statement in (attach, f"USE {name}"):
        connection.execute(statement)


def run_at_once(connection: duckdb.DuckDBPyConnection, statements: Iterable[str]) -> None:
    """Run statements in one transaction, so that the disk is waited for once."""
    connection.execute("BEGIN")
    for statement in statements:
        connection.execute(statement)
    connection.execute("COMMIT")


def detach_new(connection: duckdb.DuckDBPyConnection, path: Path, name: str) -> None:
    """Write a file of `attach_new` completely, detach it and put it in its place."""
    _detach(connection, name)
    plain = plain_paths.plain_path(path.parent, path.name)
    plain_paths.move_back(plain, path.parent, path.name)
    _checked[_identity(path)] = None


def _detach(connection: duckdb.DuckDBPyConnection, name: str) -> None:
    for statement in (f"CHECKPOINT {name}", "USE memory", f"DETACH {name}"):
        connection.execute(statement)


def _lock(connection: duckdb.DuckDBPyConnection, memory: str) -> None:
    """Bound memory and threads and lock the configuration, unless another connection did so."""
    settings = {**_SETTINGS, "memory_limit": memory} if memory else _SETTINGS
    try:
        for name, value in settings.items():
            connection.execute(f"SET {name} = '{value}'")
        connection.execute("SET lock_configuration = true")
    except duckdb.InvalidInputException as error:
        if "locked" not in str(error):
            raise


def require_regular(path: Path) -> None:
    """Raise RequestError where `path` is no regular file, or a write-ahead log lies beside it.

    DuckDB would replay the log: the content would no longer match the published checksum.
    """
    safe_files.checked_path(path.parent, path.name)
    if not path.exists():
        raise RequestError(f"{path}: missing; run `s2r verify`")
    log = path.with_name(f"{path.name}.wal")
    if os.path.lexists(log):
        raise RequestError(f"{log}: a write-ahead log beside a published file; remove it")


def _link(path: Path) -> str:
    """The path by which DuckDB opens an existing file."""
    return str(plain_paths.link(path.parent, path.name))


def escaped(text: str) -> str:
    """Escape text for an SQL string literal."""
    return text.replace("'", "''")


def _check(
    connection: duckdb.DuckDBPyConnection,
    tables: Sequence[Table],
    views: Sequence[str],
    path: Path,
    database: str | None = None,
) -> None:
    """Check the catalog, unless this file, or one of the same content, has passed before."""
    identity = _identity(path)
    if identity in _checked:
        return
    key = catalog_check_cache.key(path, repr((duckdb.__version__, tables, views)))
    if key is None or not catalog_check_cache.contains(key):
        catalog_check.check(connection, tables, views, path, database)
        if key is not None:
            catalog_check_cache.add(key)
    _checked[identity] = None


def _identity(path: Path) -> tuple[int, ...]:
    status = path.stat()
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns
