"""What there is to compute for a run, cut into work units whose names say what they depend on.

An array's key is a hash over all that its values depend on, so an array of one key never changes.
A unit is one shard of every array of one stage.
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
from s2rstore.arrays.stored_array import StoredArray
from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.files.ledger import Ledger
from s2rstore.reader import Store
from s2rstore.records import SIDES, Run
from s2rstore.run_inputs import FRAME_KINDS

KEY_VERSION = 1


@dataclass(frozen=True, slots=True)
class ArraySpec:
    """One array of a run before it is written; `item` is the shape of one row."""

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

    @property
    def name(self) -> str:
        return ".".join(
            part for part in (self.kind.replace(":", "."), self.mode, self.side) if part
        )

    def path(self, run: str) -> str:
        """Inside runs.zarr."""
        return f"{run}/{self.key}/{self.name}"

    def opened(self, root: Path, run: str) -> StoredArray:
        """The stored array. RequestError where it is not as this describes it."""
        found = stored_array.open_read(root / layout.RUNS / self.path(run), root)
        if (found.shape, found.layout.dtype) != ((self.rows, *self.item), self.dtype):
            raise RequestError(
                f"{found.path}: {found.layout.dtype} {found.shape} in place of {self.dtype} "
                f"{(self.rows, *self.item)}; run `s2r verify`"
            )
        return found


@dataclass(frozen=True, slots=True)
class Stage:
    """Arrays that are computed together, `shard_rows` rows at a time.

    `sources` are the arrays of the same run that they are computed from; those must be complete.
    """

    name: str
    run: str
    specs: tuple[ArraySpec, ...]
    shard_rows: int
    sources: tuple[ArraySpec, ...] = ()

    @property
    def rows(self) -> int:
        return self.specs[0].rows

    def unit_key(self, shard: int) -> str:
        digest = hashlib.sha256("|".join(spec.path(self.run) for spec in self.specs).encode())
        return f"{self.run}:{self.name}:{digest.hexdigest()[:12]}:{shard}"

    def shards(self) -> range:
        return range(-(-self.rows // self.shard_rows))

    def span(self, shard: int) -> tuple[int, int]:
        start = shard * self.shard_rows
        return start, min(start + self.shard_rows, self.rows)

    def create(self, root: Path) -> None:
        """Make the stage's empty arrays, or leave those that are there."""
        for spec in self.specs:
            plan = stored_array.plan(spec.rows, spec.item, spec.dtype, self.shard_rows)
            path = root / layout.RUNS / spec.path(self.run)
            stored_array.create(path, plan, dict(spec.attributes), root)

    def kept(self, root: Path) -> Callable[[str, str], Any] | None:
        """Where the arrays of rendered frames are among the sources; None without any."""
        kinds = set(FRAME_KINDS.values())
        if not any(spec.kind in kinds for spec in self.sources):
            return None
        return partial(self.source, root)

    def source(self, root: Path, kind: str, side: str, mode: str | None = None) -> StoredArray:
        """The stored array of a source."""
        for spec in self.sources:
            if spec.kind == kind and spec.side in (side, None) and spec.mode == mode:
                return spec.opened(root, self.run)
        raise KeyError(f"stage {self.name} has no source {kind} {side} {mode}")

    def valid(self, root: Path) -> NDArray[np.bool_]:
        """The instances whose pose both sides predicted, shape (N,)."""
        poses = [np.asarray(self.source(root, "prediction", side)[:]) for side in SIDES]
        return np.asarray(np.isfinite(poses).all(axis=(0, 2)))

    def file(self, spec: ArraySpec, shard: int) -> str:
        """The shard's file, inside the store."""
        folder = Path(layout.RUNS) / spec.path(self.run)
        return stored_array.shard_file(folder, shard, 1 + len(spec.item)).as_posix()

    def write(self, root: Path, shard: int, values: dict[ArraySpec, Any]) -> None:
        """Write one shard of each given array and record them in the ledger."""
        files = []
        for spec, rows in values.items():
            path = root / layout.RUNS / spec.path(self.run)
            file = stored_array.write_shard(path, shard, rows, root)
            files.append((file.relative_to(root).as_posix(), len(rows)))
        Ledger(root).add(self.unit_key(shard), files)


@dataclass(frozen=True, slots=True)
class WorkUnit:
    """One shard of the arrays that are still missing there."""

    stage: Stage
    shard: int
    missing: tuple[ArraySpec, ...]

    @property
    def rows(self) -> int:
        start, stop = self.stage.span(self.shard)
        return stop - start


def content_key(facts: dict[str, Any]) -> str:
    """A short hash of plain facts, independent of their order."""
    text = json.dumps({"version": KEY_VERSION, **facts}, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def run_dependencies(store: Store, run: Run, backend: dict[str, Any]) -> dict[str, Any]:
    """All that a run's predictions depend on."""
    model = store.models[run.model]
    return {
        "dataset": store.dataset.hash,
        "model": model.sha256,
        "architecture": model.architecture,
        "convention": model.convention,
        "sim": [run.sim_domain, run.sim_adjustments],
        "real": [run.real_domain, run.real_adjustments],
        "backend": backend,
    }


def missing_units(root: Path, stages: Sequence[Stage]) -> Iterator[WorkUnit]:
    """The units that ledger and checksums do not prove done."""
    ledger = Ledger(root)
    entries = ledger.by_path()
    for stage in stages:
        for shard in stage.shards():
            missing = tuple(
                spec for spec in stage.specs
                if not ledger.proves(entries.get(stage.file(spec, shard), []))
            )  # fmt: skip
            if missing:
                yield WorkUnit(stage, shard, missing)
