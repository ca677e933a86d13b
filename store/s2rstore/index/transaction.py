"""Write a store: build the index of the next generation, then publish it in one step."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError, one_line
from s2rstore.files import atomic_writes, layout, locks, plain_paths, safe_files
from s2rstore.index import locked_connection, pair_view, row_files, schema
from s2rstore.index.file_tables import FileTables

Check = Callable[[], None]
ColumnData = Mapping[str, NDArray[Any] | Sequence[Any]]


class IndexTransaction:
    """The index of the next generation, before it is published.

    Starts as a copy of the current one. Everything written here becomes visible at once when
    the `edit` block ends, or never. `tables` are those whose rows are in files. `generation` is 0
    until it is published.
    """

    def __init__(self, connection: duckdb.DuckDBPyConnection, tables: FileTables) -> None:
        self._connection = connection
        self._tables = tables
        self.generation = 0

    def insert(self, table: str, columns: ColumnData) -> None:
        """Append rows given as equally long columns; NaN and None become NULL.

        Missing columns become NULL. Raises KeyError for unknown names.
        """
        _check_names(table, columns)
        arrays = {name: _column(values) for name, values in columns.items()}
        if not arrays or len(next(iter(arrays.values()))) == 0:
            return
        values, constants, varying = [], [], {}
        for name, array in arrays.items():
            if _is_one_text(array):  # converting equal texts one by one takes longest of all
                values.append("?")
                constants.append(array[0])
            else:
                quoted = f'"{name}"'
                is_number = array.dtype.kind == "f"
                values.append(f"nullif({quoted}, 'NaN'::DOUBLE)" if is_number else quoted)
                varying[name] = array
        names = ", ".join(f'"{name}"' for name in arrays)
        rows = varying or {"row": np.arange(len(next(iter(arrays.values()))))}
        self._connection.register("incoming", rows)
        self._connection.execute(
            f"INSERT INTO {self._tables.target(table)} ({names}) "
            f"SELECT {', '.join(values)} FROM incoming",
            constants,
        )
        self._connection.unregister("incoming")

    def insert_row(self, table: str, row: Mapping[str, Any]) -> None:
        """Append one row; dicts, lists and tuples are stored as JSON text."""
        self.insert_rows(table, [row])

    def insert_rows(self, table: str, rows: Sequence[Mapping[str, Any]]) -> None:
        """Append rows with the same columns; dicts, lists and tuples are stored as JSON text."""
        columns = {name: [_cell(row[name]) for row in rows] for name in (rows[0] if rows else ())}
        self.insert(table, columns)

    def delete(self, table: str, **where: str) -> None:
        """Remove the rows whose columns equal the given values."""
        _check_names(table, where)
        self._tables.forget(table, where)
        condition = " AND ".join(f'"{name}" = ?' for name in where) or "true"
        query = f"DELETE FROM {self._tables.target(table)} WHERE {condition}"
        self._connection.execute(query, list(where.values()))

    def update(self, table: str, where: Mapping[str, Any], values: Mapping[str, Any]) -> None:
        """Set columns of the rows whose columns equal the given values."""
        _check_names(table, (*where, *values))
        self._tables.load(table, where)
        changes = ", ".join(f'"{name}" = ?' for name in values)
        condition = " AND ".join(f'"{name}" = ?' for name in where)
        query = f"UPDATE {self._tables.target(table)} SET {changes} WHERE {condition}"
        self._connection.execute(query, [*values.values(), *where.values()])

    def set_provenance(self, what: str, facts: Mapping[str, Any]) -> None:
        """Set provenance facts of `what`, replacing those of the same key."""
        for key, value in facts.items():
            self.delete("provenance", what=what, key=key)
            text = value if isinstance(value, str) else _json_text(value)
            self.insert_row("provenance", {"what": what, "key": key, "value": text})

    def record_checksums(self, checksums: Mapping[str, str]) -> None:
        """Record the SHA-256 of files, by their paths inside the store."""
        self._connection.execute(
            "DELETE FROM provenance WHERE what = ? AND key IN (SELECT unnest(?::VARCHAR[]))",
            [schema.CHECKSUMS, list(checksums)],
        )
        rows = {"what": [schema.CHECKSUMS] * len(checksums), "key": list(checksums)}
        self.insert("provenance", {**rows, "value": list(checksums.values())})

    def rows(self, query: str, parameters: Sequence[Any] = ()) -> list[tuple[Any, ...]]:
        """The rows of a query on the unpublished index."""
        return self._connection.execute(query, list(parameters)).fetchall()


@contextmanager
def edit(root: Path, check: Check = lambda: None) -> Iterator[IndexTransaction]:
    """Publish the next generation of the store at `root` with the changes made in the block.

    An exception inside leaves the store at its current generation. A folder without a
    generation gets its first one. `check` is called before anything is published, for callers
    that hold a further lock: `Lease.check` of that. Raises StoreBusyError where the publish lock
    is held by another process, or was taken over while this process was suspended.
    """
    check_writable(root)
    with locks.publish_lock(root) as lease:

        def check_leases() -> None:
            check()
            lease.check()

        is_new = safe_files.kind(root, layout.CURRENT) is None
        base = None if is_new else layout.read_current(root)
        for entry in safe_files.names(root, layout.INDEX):
            if entry.name.startswith(".building-"):  # of a writer that has lost the lock
                atomic_writes.remove(root, entry.path)
        building, compacted = (
            f"{layout.INDEX}/.building-{secrets.token_hex(8)}.duckdb" for _ in range(2)
        )
        folder = root / layout.INDEX
        connection = locked_connection.connect_empty([folder], search_folder=folder)
        tables = FileTables(connection, root)
        try:
            _begin(connection, root, building, base, tables)
            draft = IndexTransaction(connection, tables)
            yield draft
            check_leases()  # a new holder of the lock has removed this index
            rows = connection.execute("SELECT hash FROM dataset").fetchall()
            moved = tables.move_large_tables()
            tables.write()
            finished = compacted if moved else building
            if moved:
                _copy_without(connection, root, compacted, [*tables.names, *moved])
            check_leases()
            tables.finish()
            locked_connection.detach_new(
                connection, root / finished, "compacted" if moved else "draft"
            )
            connection.close()
            dataset_hash = str(rows[0][0]) if rows else ""
            generation = _next_generation(root, base)
            _publish(root, finished, generation, dataset_hash, check_leases)
            draft.generation = generation
        except duckdb.IOException as error:
            reason = one_line(error)
            raise RequestError(f"{root}: the index cannot be written ({reason})") from error
        finally:
            connection.close()
            tables.remove_partial()
            for path in (building, compacted):
                atomic_writes.remove(root, path)
                atomic_writes.remove(root, f"{path}.wal")
                for name in (Path(path).name, f"{Path(path).name}.wal"):
                    plain_paths.discard(folder, name)


def check_writable(root: Path) -> None:
    """Raise RequestError where no generation can be published."""
    folder = root / layout.INDEX
    try:
        root.mkdir(parents=True, exist_ok=True)
        atomic_writes.make_folder(root, layout.INDEX)
    except OSError as error:
        raise RequestError(f"{folder}: cannot be written ({error.strerror})") from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise RequestError(f"{folder}: cannot be written (the store is read-only)")


def _begin(
    connection: duckdb.DuckDBPyConnection,
    root: Path,
    building: str,
    base: layout.Current | None,
    tables: FileTables,
) -> None:
    """Make the draft, and copy what the present generation has inside its index."""
    if base is not None:
        path = safe_files.checked_path(root, base.index)
        locked_connection.attach_read_only(connection, path, "base")
        files = row_files.listed(connection, path, "base")
        row_files.check_present(path, files)
        tables.take_over(files)
    beside = safe_files.checked_path(root, building)
    locked_connection.attach_new(connection, beside, "draft", _empty_index(tables.names))
    if base is not None:
        _copy_tables(connection, "base", "draft", tables.names)
        connection.execute("DETACH base")
    tables.begin()


def _empty_index(without: Sequence[str]) -> list[str]:
    """The SQL that makes an empty index, comments included.

    The tables `without` are left out, and with them the view `pair`, which may need them.
    """
    tables = schema.statements(without)
    return tables if without else tables + pair_view.statements()


def _copy_tables(
    connection: duckdb.DuckDBPyConnection, source: str, target: str, without: Sequence[str]
) -> None:
    """Copy the known tables of an attached index, apart from `without` and the list of files."""
    for table in schema.TABLES:
        if table.name in (*without, row_files.TABLE):
            continue
        names = ", ".join(f'"{name}"' for name in table.column_names)
        rows = f'SELECT {names} FROM {source}."{table.name}"'
        connection.execute(f'INSERT INTO {target}."{table.name}" ({names}) {rows}')


def _copy_without(
    connection: duckdb.DuckDBPyConnection, root: Path, path: str, without: Sequence[str]
) -> None:
    """Copy the draft to another file, without tables whose rows have moved to files.

    To drop these tables would leave their space in the file.
    """
    target = safe_files.checked_path(root, path)
    locked_connection.attach_new(connection, target, "compacted", _empty_index(without))
    _copy_tables(connection, "draft", "compacted", without)
    connection.execute("DETACH draft")


def _check_names(table: str, names: Iterable[str]) -> None:
    unknown = set(names) - set(schema.BY_NAME[table].column_names)
    if unknown:
        raise KeyError(f"{table} has no column {min(unknown)}")


def _publish(root: Path, building: str, generation: int, dataset_hash: str, check: Check) -> None:
    name = layout.index_name(generation)
    atomic_writes.sync(root, building)
    check()
    atomic_writes.rename(root, building, name)
    current = layout.Current(
        generation=generation,
        index=name,
        sha256=safe_files.sha256(root, name),
        bytes=safe_files.size(root, name),
        schema=schema.VERSION,
        dataset_hash=dataset_hash,
    )
    layout.write_current(root, current, check)


def _next_generation(root: Path, base: layout.Current | None) -> int:
    """One above every number that was ever used: a name is never used again."""
    entries = safe_files.names(root, layout.INDEX)
    used = [layout.generation_of(Path(entry.path)) or 0 for entry in entries]
    return max([*used, base.generation if base else 0]) + 1


def _column(values: NDArray[Any] | Sequence[Any]) -> NDArray[Any]:
    if isinstance(values, np.ndarray) and values.dtype != object:
        return values
    listed = list(values)
    known = [value for value in listed if value is not None]
    if known and len(known) == len(listed) and not isinstance(known[0], str):
        return np.asarray(listed)
    if known and isinstance(known[0], bool | int | float):
        return np.array([np.nan if v is None else float(v) for v in listed])
    return np.array(listed, dtype=object)


def _is_one_text(array: NDArray[Any]) -> bool:
    first = array[0]
    return array.dtype == object and isinstance(first, str) and bool((array == first).all())


def _cell(value: Any) -> Any:
    return _json_text(value) if isinstance(value, dict | list | tuple) else value


def _json_text(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), sort_keys=True, default=_json_value)


def _json_value(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is not a JSON value")
