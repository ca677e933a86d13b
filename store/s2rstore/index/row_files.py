"""Rows of large tables in Parquet files beside the index.

Every generation has an index of its own, which starts as a copy of the one before. The rows of runs
would make these copies as large as all runs together. So a table of `PARTITIONS` with more than
`MAX_ROWS` rows moves to immutable files below `index/rows/`, which generations share: one file per
run, or for tables without runs one per ingest. Table `row_file` lists them, and the table itself
becomes a view over them. Names of files begin with the SHA-256 of their content, so rows that are
published again add no file.

Paths in the views are relative to the folder of the index, so that a store can be moved. Plain
DuckDB finds them after `SET file_search_path`. `s2rstore` does not use these views: a connection of
`locked_connection` has its own over the same files by their absolute paths.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import duckdb
import msgspec
from msgspec import Meta

from s2rstore.errors import RequestError, first_line
from s2rstore.files.plain_paths import plain_path
from s2rstore.files.store_files import LocalFiles, StoreFiles
from s2rstore.index import schema
from s2rstore.records import Name

MAX_ROWS = 1_000_000
"""Rows that a table may have inside an index; copying so many takes one or two seconds."""
TABLE = "row_file"
"""The table that lists the files."""
FOLDER = "rows"
"""The folder of the files, beside the index."""
PARTITIONS: dict[str, str | None] = {
    "prediction": "run", "projection": "run", "label_gain": "run", "frame": None,
    "frame_label": None,
}  # fmt: skip
"""Tables whose rows may lie in files, and the column that is constant within a file, if any."""
MAX_ROWS_PER_BYTE = 1.0
"""Rows of a table per byte of its file: real poses take more than a byte, repetitions do not."""

_MAX_FILES = 200_000
_OPTIONS = "hive_partitioning = false, union_by_name = true"
_FOLDER_NAME = "parse_filename(parse_dirpath(filename))"


@dataclass(frozen=True, slots=True)
class RowFile:
    """A file of rows: those of one run, or with `run` None some of a table without runs.

    `path` is relative to the folder of the index.
    """

    table: str
    run: Name | None
    path: str
    sha256: Annotated[str, Meta(pattern=r"\A[0-9a-f]{64}\Z")]
    bytes: int
    rows: Annotated[int, Meta(ge=1)]


RowFiles = Mapping[str, Sequence[RowFile]]
"""Files by the name of their table; tables without files are missing."""


def path_of(table: str, run: str | None, sha256: str) -> str:
    """The path of a file, relative to the folder of the index."""
    return "/".join(filter(None, (FOLDER, table, run, f"{sha256[:16]}.parquet")))


def listed(
    connection: duckdb.DuckDBPyConnection, path: Path, database: str | None = None
) -> dict[str, list[RowFile]]:
    """The files that the index at `path` lists.

    Read table `row_file` of an attached `database`, or of the connection's own. Its columns must
    have been checked. Raises RequestError for a row that no store of this program has.
    """
    columns = ", ".join(schema.BY_NAME[TABLE].column_names)
    name = f'"{database}".{TABLE}' if database else TABLE
    query = f"SELECT {columns} FROM {name} ORDER BY table_name, run, path LIMIT {_MAX_FILES + 1}"
    rows = connection.execute(query).fetchall()
    if len(rows) > _MAX_FILES:
        raise RequestError(f"{path}: table row_file: more than {_MAX_FILES} rows")
    files: dict[str, list[RowFile]] = {}
    for row in rows:
        file = RowFile(*row)
        if not _is_valid(file):
            what = repr((file.table, file.run, file.path))[:120]
            raise RequestError(f"{path}: table row_file: invalid row {what}; run `s2r verify`")
        files.setdefault(file.table, []).append(file)
    for table, group in files.items():
        keys = [file.path if PARTITIONS[table] is None else file.run for file in group]
        if len(set(keys)) < len(keys):
            raise RequestError(f"{path}: table row_file: {table} twice; run `s2r verify`")
    return files


def _is_valid(file: RowFile) -> bool:
    try:
        msgspec.convert(asdict(file), RowFile)
    except msgspec.ValidationError:
        return False
    return (
        file.table in PARTITIONS
        and (file.run is None) == (PARTITIONS[file.table] is None)
        and file.path == path_of(file.table, file.run, file.sha256)
        and file.rows <= MAX_ROWS_PER_BYTE * file.bytes
    )


def select(table: str, files: Iterable[RowFile], folder: Path | None = None) -> str:
    """The SELECT over the rows of `files`, with the table's columns.

    Paths are relative, or those of `plain_path` below `folder`, that of the index. A filter on the
    run reads the files of that run alone, since the run is the name of the folder that holds a
    file.
    """
    columns = schema.BY_NAME[table].columns
    empty = ", ".join(f'NULL::{column.type} AS "{column.name}"' for column in columns)
    files = list(files)
    if not files:
        return f"SELECT {empty} WHERE false"
    paths = (file.path if folder is None else plain_path(folder, file.path) for file in files)
    literals = ", ".join("'" + str(path).replace("'", "''") + "'" for path in paths)
    partition = PARTITIONS[table]
    stored = "*" if partition is None else f"*, {_FOLDER_NAME} AS {partition}"
    options = _OPTIONS if partition is None else f"filename = true, {_OPTIONS}"
    names = ", ".join(f'"{column.name}"' for column in columns)
    return (
        f"SELECT {names} FROM (SELECT {empty} WHERE false UNION ALL BY NAME "
        f"SELECT {stored} FROM read_parquet([{literals}], {options}))"
    )


def view(table: str, files: Iterable[RowFile], folder: Path | None = None) -> str:
    """The statement that makes the view in place of a table, see `select`."""
    return f"CREATE VIEW {table} AS {select(table, files, folder)}"


def stored_columns(
    connection: duckdb.DuckDBPyConnection, folder: Path, files: Iterable[RowFile]
) -> dict[str, dict[str, str]]:
    """Types of the columns of each file, by its `plain_path` below `folder`, that of the index."""
    paths = [str(plain_path(folder, file.path)) for file in files]
    query = "SELECT file_name, name, duckdb_type FROM parquet_schema(?) WHERE type IS NOT NULL"
    found: dict[str, dict[str, str]] = {path: {} for path in paths}
    for path, name, kind in connection.execute(query, [paths]).fetchall() if paths else []:
        found[path][name] = kind
    return found


def check_types(connection: duckdb.DuckDBPyConnection, tables: Iterable[str], path: Path) -> None:
    """Raise RequestError where a view over files has other columns than its table should have.

    `path` is the index.
    """
    for table in tables:
        try:
            cursor = connection.execute(f'SELECT * FROM "{table}" LIMIT 0')
        except duckdb.Error as error:
            reason = first_line(error)
            raise RequestError(f"{path}: table {table}: {reason}; run `s2r verify`") from error
        present = [(name, str(kind)) for name, kind, *_ in cursor.description or ()]
        if present != [(column.name, column.type) for column in schema.BY_NAME[table].columns]:
            raise RequestError(
                f"{path}: table {table}: its files have other columns; run `s2r verify`"
            )


def problem(files: StoreFiles, folder: str, file: RowFile) -> str:
    """What is wrong with the presence and size of a file; an empty text where nothing is.

    `folder` is that of the index in the store. The content is not read.
    """
    try:
        size = files.size(f"{folder}/{file.path}")
    except (FileNotFoundError, NotADirectoryError):
        return "missing"
    except (RequestError, OSError) as error:
        return first_line(error)
    return "" if size == file.bytes else f"{size} bytes instead of the published {file.bytes}"


def check_present(index: Path, files: RowFiles) -> None:
    """Raise RequestError that names a listed file that is missing, a link, or of another size."""
    for file in (file for group in files.values() for file in group):
        reason = problem(LocalFiles(index.parent.parent), index.parent.name, file)
        if reason:
            path = index.parent / file.path
            reason = reason.removeprefix(f"{path}: ")
            raise RequestError(f"{path}: {reason}; run `s2r verify`, and restore the file")


def check_files(connection: duckdb.DuckDBPyConnection, index: Path, files: RowFiles) -> None:
    """Raise RequestError where a file has other columns or rows than the index lists.

    A file of repeated values could otherwise hold far more rows than its size lets expect.
    """
    expected = {
        str(plain_path(index.parent, file.path)): file for group in files.values() for file in group
    }
    query = "SELECT file_name, num_rows FROM parquet_file_metadata(?)"
    try:
        rows = connection.execute(query, [list(expected)]).fetchall() if expected else []
        columns = stored_columns(connection, index.parent, expected.values())
    except duckdb.Error as error:
        reason = first_line(error)
        raise RequestError(f"{index}: rows cannot be read ({reason}); run `s2r verify`") from error
    counts = dict(rows)
    for plain, file in expected.items():
        path = index.parent / file.path
        if counts.get(plain) != file.rows:
            raise RequestError(
                f"{path}: {counts.get(plain)} rows instead of {file.rows}; run `s2r verify`"
            )
        if not _has_columns(columns[plain], file.table):
            raise RequestError(
                f"{path}: other columns than those of table {file.table}; run `s2r verify`"
            )


def _has_columns(stored: Mapping[str, str], table: str) -> bool:
    """Whether a file with columns of these types holds rows of a table."""
    partition = PARTITIONS[table]
    if partition in stored:
        return False
    return all(
        stored.get(column.name) == column.type
        for column in schema.BY_NAME[table].columns
        if column.name != partition
    )
