"""The index of a store at one generation: its tables as records."""

from __future__ import annotations

import contextlib
import json
from functools import cached_property
from pathlib import Path
from threading import RLock
from typing import Any

import duckdb

from s2rstore import layout, sandbox, schema
from s2rstore.errors import RequestError
from s2rstore.geometry.alignment import Correction
from s2rstore.input_files import parse_object
from s2rstore.records import (
    ArrayRecord,
    Bounds,
    Dataset,
    Domain,
    Intrinsics,
    Model,
    Room,
    Run,
    Trajectory,
)


class Tables:
    """The tables of an open index; any thread may read them."""

    def __init__(self, path: str | Path, memory: str = "", generation: int | None = None) -> None:
        """At the published generation, or at an earlier one; `memory`: see `sandbox.connect`.

        Raises RequestError where `path` holds no store that this version can read.
        """
        self.path = Path(path)
        current = layout.read_current(self.path)
        if current.schema != schema.VERSION:
            raise RequestError(
                f"{path}: schema {current.schema}, this program reads {schema.VERSION}; "
                "use the release that wrote it, or ingest again"
            )
        self.generation = current.generation if generation is None else generation
        self._index = self.path / layout.index_name(self.generation)
        self._lock = RLock()
        self._opened: duckdb.DuckDBPyConnection | None = sandbox.connect(self._index, memory)

    def close(self) -> None:
        """Let the index go."""
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
        return layout.read_current(self.path).generation

    def connection(self) -> duckdb.DuckDBPyConnection:
        """A new read-only connection to this generation's index, for use in another thread."""
        with self._lock:
            return self._connection.cursor()

    def execute(self, sql: str, parameters: list[Any] | None = None) -> list[tuple[Any, ...]]:
        """All rows of a query."""
        return self.connection().execute(sql, parameters or []).fetchall()

    def _rows(self, table: str) -> list[dict[str, Any]]:
        known = schema.BY_NAME[table]
        names = ", ".join(f'"{name}"' for name in known.column_names)
        try:
            found = self.execute(f'SELECT {names} FROM "{table}" ORDER BY {", ".join(known.order)}')
        except duckdb.Error as error:
            raise RequestError(
                f"{self._index}: no table {table} as this program knows it; run `s2r verify`"
            ) from error
        return [dict(zip(known.column_names, row, strict=True)) for row in found]

    @cached_property
    def dataset(self) -> Dataset:
        rows = self._rows("dataset")
        if not rows:
            raise RequestError(f"{self.path}: holds no data set; run `s2r ingest`")
        row = rows[0]
        bounds = Bounds(*(row.pop(f"bounds_{name}") for name in ("x0", "y0", "x1", "y1")))
        return Dataset(bounds=bounds, **row)

    @cached_property
    def trajectories(self) -> tuple[Trajectory, ...]:
        """In the order of their instances."""
        rows = self._rows("trajectory")
        return tuple(Trajectory(**row) for row in rows if self._name(row, "trajectory"))

    @cached_property
    def rooms(self) -> tuple[Room, ...]:
        """Rectangles in order of precedence."""
        return tuple(Room(**row) for row in self._rows("room"))

    @cached_property
    def domains(self) -> dict[str, Domain]:
        return {self._name(row, "domain"): _domain(row) for row in self._rows("domain")}

    def domain(self, name: str) -> Domain:
        """Raises RequestError with the known names."""
        if name not in self.domains:
            known = ", ".join(self.domains)
            raise RequestError(f"domain {name!r}: not in {self.path} (domains: {known})")
        return self.domains[name]

    @cached_property
    def models(self) -> dict[str, Model]:
        return {self._name(row, "model"): Model(**row) for row in self._rows("model")}

    @cached_property
    def runs(self) -> dict[str, Run]:
        """In order of creation."""
        runs = {}
        for row in self._rows("run"):
            for side in ("sim", "real"):
                row[f"{side}_adjustments"] = json.loads(row[f"{side}_adjustments"])
            runs[self._name(row, "run")] = Run(**row)
        return runs

    def _name(self, row: dict[str, Any], what: str) -> str:
        """A name that paths are made of; RequestError where it could lead out of the store."""
        try:
            return layout.checked_name(row[what], what)
        except RequestError as error:
            raise RequestError(f"{self.path}: {error}") from error

    def run(self, name: str | None = None) -> Run:
        """The named run, by default the first computed one; RequestError with the known names."""
        if name is None:
            computed = [run for run in self.runs.values() if run.key]
            if not computed:
                raise RequestError(f"{self.path}: no computed run; `s2r precompute` makes them")
            return computed[0]
        if name not in self.runs:
            known = ", ".join(self.runs) or "none"
            raise RequestError(f"run {name!r}: not in {self.path} (runs: {known})")
        return self.runs[name]

    def lacking(self, table: str) -> frozenset[str]:
        """The columns that this index, written by an earlier release, does not have."""
        cursor = self.connection().execute(f'SELECT * FROM "{table}" LIMIT 0')
        found = {column[0] for column in cursor.description}
        optional = {c.name for c in schema.BY_NAME[table].columns if c.optional}
        return frozenset(optional - found)

    def provenance(self, what: str) -> dict[str, str]:
        """Facts about how `what` came to be, such as `dataset` or `model:NAME`."""
        found = self.execute(
            "SELECT key, value FROM provenance WHERE what = ? ORDER BY key", [what]
        )
        return dict(found)

    def provenance_object(self, what: str, key: str) -> dict[str, Any]:
        """One fact that is a JSON object; empty where it was not noted. Raises RequestError."""
        text = self.provenance(what).get(key, "{}")
        return parse_object(text, f"{self.path}: provenance of {what}: {key}")

    def correction(self, sim: str, real: str) -> Correction | None:
        """What the declared real rig was found to be off by; None where nobody has looked."""
        noted = self.provenance(f"alignment:{sim}|{real}")
        try:
            if not noted:
                return None
            found = Correction(float(noted["height"]), float(noted["zoom"]))
            if not (abs(found.height) < 10 and 0.1 < found.zoom < 10):
                raise ValueError("out of range")
            return found
        except (KeyError, ValueError) as error:
            message = f"{self.path}: the alignment of {sim} and {real} makes no sense"
            raise RequestError(message) from error

    @cached_property
    def _array_records(self) -> dict[str, list[ArrayRecord]]:
        grouped: dict[str, list[ArrayRecord]] = {}
        for row in self._rows("zarr_array"):
            row["shape"] = tuple(json.loads(row["shape"]))
            row["axes"] = tuple(json.loads(row["axes"]))
            grouped.setdefault(row["run"], []).append(ArrayRecord(**row))
        return grouped

    def arrays(self, run: str) -> list[ArrayRecord]:
        """The published arrays of a run."""
        return list(self._array_records.get(self.run(run).run, ()))


def _domain(row: dict[str, Any]) -> Domain:
    figures = ("fx", "fy", "cx", "cy", "pitch")
    rgb, depth = (
        Intrinsics(*(row.pop(f"{image}_{figure}") for figure in figures))
        for image in ("rgb", "depth")
    )
    sources = json.loads(row.pop("source") or "{}")
    return Domain(rgb=rgb, depth=depth, sources=sources, **row)
