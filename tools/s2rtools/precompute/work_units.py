"""Work units of a run: arrays with content keys, stages and shards.

An array's key is a hash over everything that its values depend on, so the array of a key never
changes. A stage is a group of arrays that are computed together; a unit is one shard of them.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import stored_array
from s2rstore.arrays.row_array import PartedArray, RowArray
from s2rstore.arrays.stored_array import StoredArray
from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.files.ledger import Ledger
from s2rstore.reader import Store
from s2rstore.records import SIDES, Part, Run
from s2rstore.run_inputs import FRAME_KINDS
from s2rtools.heatmaps import HEATMAP_KINDS

KEY_VERSION = 1


@dataclass(frozen=True, slots=True)
class ArraySpec:
    """Description of one array of a run; `item` is the shape of one row.

    Rows are the instances from `first_iid` on; those of map grids are aggregates over instances.
    """

    kind: str
    side: str | None
    mode: str | None
    item: tuple[int, ...]
    dtype: str
    axes: tuple[str, ...]
    unit: str
    key: str
    rows: int
    attributes: tuple[tuple[str, str], ...] = ()
    first_iid: int = 0

    def path(self, run: str) -> str:
        """Path inside runs.zarr."""
        parts = self.kind.replace(":", "."), self.mode, self.side
        return f"{run}/{self.key}/{'.'.join(part for part in parts if part)}"

    def open_array(self, root: Path, run: str) -> StoredArray:
        """Open the stored array. Raises RequestError if its shape or dtype differs."""
        array = stored_array.open_read(root / layout.RUNS / self.path(run), root)
        if (array.shape, array.layout.dtype) != ((self.rows, *self.item), self.dtype):
            raise RequestError(
                f"{array.path}: {array.layout.dtype} {array.shape} instead of {self.dtype} "
                f"{(self.rows, *self.item)}; run `s2r verify`"
            )
        return array


@dataclass(frozen=True, slots=True)
class Stage:
    """Arrays that are computed together, `shard_rows` rows at a time.

    `sources` are the complete arrays of the same run that they are computed from. Where something
    is fitted, it is fitted on the instances [0, `fitted`).
    """

    name: str
    run: str
    specs: tuple[ArraySpec, ...]
    shard_rows: int
    sources: tuple[ArraySpec, ...] = ()
    fitted: int = 0

    @property
    def rows(self) -> int:
        return self.specs[0].rows

    @property
    def first_iid(self) -> int:
        return self.specs[0].first_iid

    @property
    def is_network(self) -> bool:
        """Whether the units run the network."""
        return self.name == "forward" or self.name in HEATMAP_KINDS

    def specs_of_kind(self, kind: str) -> tuple[ArraySpec, ...]:
        return tuple(spec for spec in self.specs if spec.kind == kind)

    def create(self, root: Path) -> None:
        """Create the stage's empty arrays that do not exist yet."""
        for spec in self.specs:
            plan = stored_array.plan_layout(spec.rows, spec.item, spec.dtype, self.shard_rows)
            path = root / layout.RUNS / spec.path(self.run)
            stored_array.create(path, plan, dict(spec.attributes), root)

    def rendered_arrays(self, root: Path) -> Callable[[str, str], Any] | None:
        """Function that opens the source arrays of rendered frames; None if there are none."""
        kinds = set(FRAME_KINDS.values())
        if not any(spec.kind in kinds for spec in self.sources):
            return None
        return partial(self.source_array, root)

    def source_array(
        self, root: Path, kind: str, side: str | None, mode: str | None = None
    ) -> RowArray:
        """Open the array of a source; its rows are instances, from 0 on."""
        specs = [
            spec
            for spec in self.sources
            if spec.kind == kind and spec.side in (side, None) and spec.mode == mode
        ]
        if not specs:
            raise KeyError(f"stage {self.name} has no source {kind} {side} {mode}")
        return open_parts(specs, root, self.run)

    def source_range(self, kind: str) -> range:
        """Instances of the sources of a kind, which follow one another."""
        specs = [spec for spec in self.sources if spec.kind == kind]
        return range(
            min(spec.first_iid for spec in specs), max(spec.first_iid + spec.rows for spec in specs)
        )

    def valid_instances(self, root: Path, instances: range) -> NDArray[np.bool_]:
        """Whether both sides predicted a pose, for each of `instances`, (n,)."""
        poses = [
            self.source_array(root, "prediction", side).rows(instances.start, instances.stop)
            for side in SIDES
        ]
        return np.asarray(np.isfinite(poses).all(axis=(0, 2)))

    def shard_file(self, spec: ArraySpec, shard: int) -> str:
        """Path of a shard's file inside the store."""
        folder = Path(layout.RUNS) / spec.path(self.run)
        return stored_array.shard_file(folder, shard, 1 + len(spec.item)).as_posix()

    def write(self, root: Path, shard: int, values: dict[ArraySpec, Any]) -> None:
        """Write one shard of each array in `values` and record the files in the ledger."""
        files = []
        for spec, rows in values.items():
            path = root / layout.RUNS / spec.path(self.run)
            file = stored_array.write_shard(path, shard, rows, root)
            files.append((file.relative_to(root).as_posix(), len(rows)))
        digest = hashlib.sha256("|".join(spec.path(self.run) for spec in self.specs).encode())
        Ledger(root).add(f"{self.run}:{self.name}:{digest.hexdigest()[:12]}:{shard}", files)


@dataclass(frozen=True, slots=True)
class WorkUnit:
    """One shard of a stage, and the arrays whose shard is missing."""

    stage: Stage
    shard: int
    missing: tuple[ArraySpec, ...]

    @property
    def rows(self) -> range:
        """Rows of the shard in the arrays."""
        start = self.shard * self.stage.shard_rows
        return range(start, min(start + self.stage.shard_rows, self.stage.rows))

    @property
    def instances(self) -> range:
        """Instances of the rows of the shard, where rows are instances."""
        first = self.stage.first_iid
        return range(first + self.rows.start, first + self.rows.stop)


def open_parts(specs: Sequence[ArraySpec], root: Path, run: str) -> RowArray:
    """Arrays of one kind, side and mode as one array with a row per instance, from 0 on."""
    ordered = sorted(specs, key=lambda spec: spec.first_iid)
    if len(ordered) == 1 and ordered[0].first_iid == 0:
        return ordered[0].open_array(root, run)
    parts = [(spec.first_iid, spec.open_array(root, run)) for spec in ordered]
    stop = max(spec.first_iid + spec.rows for spec in ordered)
    return PartedArray(parts, stop, f"run {run!r}: {ordered[0].kind} is not computed")


def content_key(facts: dict[str, Any]) -> str:
    """A short hash of plain facts, independent of the order of their keys."""
    text = json.dumps({"version": KEY_VERSION, **facts}, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def run_dependencies(store: Store, run: Run, part: Part, backend: dict[str, Any]) -> dict[str, Any]:
    """Everything that a run's predictions of the instances of a part depend on."""
    model = store.models[run.model]
    return {
        "dataset": part.hash,
        "model": model.sha256,
        "architecture": model.architecture,
        "convention": model.convention,
        "sim": [run.sim_domain, _without_names(run.sim_adjustments)],
        "real": [run.real_domain, _without_names(run.real_adjustments)],
        "backend": backend,
    }


def _without_names(chain: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The chain without the names of translators, on which no value depends."""
    return [{**step, "name": "translate"} if "sha256" in step else step for step in chain]


def missing_units(root: Path, stages: Sequence[Stage]) -> Iterator[WorkUnit]:
    """The units that the ledger and checksums do not prove complete."""
    ledger = Ledger(root)
    entries = ledger.by_path()
    for stage in stages:
        for shard in range(-(-stage.rows // stage.shard_rows)):
            missing = tuple(
                spec for spec in stage.specs
                if not ledger.proves(entries.get(stage.shard_file(spec, shard), []))
            )  # fmt: skip
            if missing:
                yield WorkUnit(stage, shard, missing)
