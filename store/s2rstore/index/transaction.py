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

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, locks, safe_files
from s2rstore.index import locked_connection, schema

_BASE_TABLES = "SELECT table_name FROM duckdb_tables() WHERE database_name = 'base'"

Check = Callable[[], None]
ColumnData = Mapping[str, NDArray[Any] | Sequence[Any]]


class IndexTransaction:
    """The index of the next generation, before it is published.

    Starts as a copy of the current one. Everything written here becomes visible at once when
    the `edit` block ends, or never.
    """

    def __init__(self, connection: duckdb.DuckDBPyConnection) -> None:
        self._connection = connection

    def insert(self, table: str, columns: ColumnData) -> None:
        """Append rows given as equally long columns; NaN and None become NULL.

        Missing columns become NULL. Raises KeyError for unknown names.
        """
        _check_names(table, columns)
        arrays = {name: _column(values) for name, values in columns.items()}
        if not arrays or len(next(iter(arrays.values()))) == 0:
            return
        values = [
            f"nullif(\"{name}\", 'NaN'::DOUBLE)" if array.dtype.kind == "f" else f'"{name}"'
            for name, array in arrays.items()
        ]
        names = ", ".join(f'"{name}"' for name in arrays)
        self._connection.register("incoming", arrays)
        self._connection.execute(
            f'INSERT INTO "{table}" ({names}) SELECT {", ".join(values)} FROM incoming'
        )
        self._connection.unregister("incoming")

    def insert_row(self, table: str, row: Mapping[str, Any]) -> None:
        """Append one row; dicts, lists and tuples are stored as JSON text."""
        values = {
            k: _json_text(v) if isinstance(v, dict | list | tuple) else v for k, v in row.items()
        }
        self.insert(table, {name: [value] for name, value in values.items()})

    def delete(self, table: str, **where: str) -> None:
        """Remove the rows whose columns equal the given values."""
        _check_names(table, where)
        condition = " AND ".join(f'"{name}" = ?' for name in where) or "true"
        self._connection.execute(f'DELETE FROM "{table}" WHERE {condition}', list(where.values()))

    def update(self, table: str, where: Mapping[str, str], values: Mapping[str, Any]) -> None:
        """Set columns of the rows whose columns equal the given values."""
        _check_names(table, (*where, *values))
        changes = ", ".join(f'"{name}" = ?' for name in values)
        condition = " AND ".join(f'"{name}" = ?' for name in where)
        query = f'UPDATE "{table}" SET {changes} WHERE {condition}'
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
        building = f"{layout.INDEX}/.building-{secrets.token_hex(8)}.duckdb"
        beside = safe_files.checked_path(root, building)
        connection = locked_connection.connect_empty([root / layout.INDEX])
        try:
            old = safe_files.checked_path(root, base.index) if base else None
            _begin(connection, beside, old)
            yield IndexTransaction(connection)
            check_leases()  # a new holder of the lock has removed this index
            rows = connection.execute("SELECT hash FROM dataset").fetchall()
            locked_connection.detach_new(connection, "draft")
            connection.close()
            dataset_hash = str(rows[0][0]) if rows else ""
            generation = _next_generation(root, base)
            _publish(root, building, generation, dataset_hash, check_leases)
        except duckdb.IOException as error:
            reason = " ".join(str(error).split())
            raise RequestError(f"{root}: the index cannot be written ({reason})") from error
        finally:
            connection.close()
            atomic_writes.remove(root, building)
            atomic_writes.remove(root, f"{building}.wal")


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


def _begin(connection: duckdb.DuckDBPyConnection, beside: Path, base: Path | None) -> None:
    locked_connection.attach_new(connection, beside, "draft", schema.statements())
    if base is not None:
        locked_connection.attach_read_only(connection, base, "base")
        stored = {row[0] for row in connection.execute(_BASE_TABLES).fetchall()}
        for table in schema.TABLES:
            if table.optional and table.name not in stored:
                continue
            described = connection.execute(f'SELECT * FROM base."{table.name}" LIMIT 0').description
            present = {column[0] for column in described}
            columns = [c.name for c in table.columns if c.name in present or not c.optional]
            names = ", ".join(f'"{name}"' for name in columns)
            rows = f'SELECT {names} FROM base."{table.name}"'
            connection.execute(f'INSERT INTO draft."{table.name}" ({names}) {rows}')
        connection.execute("DETACH base")


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


def _json_text(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), sort_keys=True, default=_json_value)


def _json_value(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is not a JSON value")
