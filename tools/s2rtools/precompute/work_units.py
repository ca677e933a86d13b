"""Work units of a run: arrays with content keys, stages and the units of a stage.

The array of a key never changes (`array_keys`). A stage is a group of arrays that are computed
together; a unit computes them for a range of instances. The results of units become shards of
arrays once a shard is complete (`unit_plan`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import array_writer, stored_array
from s2rstore.arrays.row_array import PartedArray, RowArray
from s2rstore.arrays.stored_array import StoredArray
from s2rstore.arrays.zarr_metadata import Layout
from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.records import SIDES
from s2rstore.run_inputs import FRAME_KINDS
from s2rtools.heatmaps import HEATMAP_KINDS

if TYPE_CHECKING:
    from s2rtools.precompute.unit_computer import UnitComputer

NUMPY = "numpy"
"""The precision of arrays that no network computes: that of their own type."""
FORWARD = "forward"
"""The stage of predictions, embeddings and the heatmaps that need one forward pass."""


@dataclass(frozen=True, slots=True)
class ArraySpec:
    """Description of one array of a run; `item` is the shape of one row.

    Rows are the instances from `first_iid` on; those of map grids are aggregates over instances.
    Arrays that do not depend on the model are stored once for all runs, if `is_shared`.
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
    is_shared: bool = False

    def path(self, run: str) -> str:
        """Path inside runs.zarr."""
        parts = self.kind.replace(":", "."), self.mode, self.side
        return f"{self.folder(run)}/{'.'.join(part for part in parts if part)}"

    def folder(self, run: str) -> str:
        """The folder inside runs.zarr of all arrays of the key."""
        return f"{layout.SHARED_ARRAYS if self.is_shared else run}/{self.key}"

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
    """Arrays that are computed together, for `unit_rows` instances at a time.

    `sources` are the complete arrays of the same run that they are computed from. Where something
    is fitted, it is fitted on the instances [0, `fitted`). The rows of the arrays are instances,
    or, if there are `aggregated` ones, aggregates over these. `compute` gives the values of the
    missing arrays of a unit; None where the arrays exist.
    """

    name: str
    run: str
    specs: tuple[ArraySpec, ...]
    unit_rows: int
    sources: tuple[ArraySpec, ...] = ()
    fitted: int = 0
    aggregated: range | None = None
    compute: Compute | None = None

    @property
    def is_aggregate(self) -> bool:
        return self.aggregated is not None

    @property
    def rows(self) -> int:
        return self.specs[0].rows

    @property
    def first_iid(self) -> int:
        return self.specs[0].first_iid

    @property
    def instances(self) -> range:
        """The instances that the stage is computed for."""
        if self.aggregated is not None:
            return self.aggregated
        return range(self.first_iid, self.first_iid + self.rows)

    def unit_instances(self, number: int) -> range:
        """The instances of a unit."""
        start = number * self.unit_rows
        return self.instances[start : start + self.unit_rows]

    @property
    def is_network(self) -> bool:
        """Whether the units run the network."""
        return self.name == FORWARD or self.name in HEATMAP_KINDS

    def specs_of_kind(self, kind: str) -> tuple[ArraySpec, ...]:
        return tuple(spec for spec in self.specs if spec.kind == kind)

    def create(self, root: Path, spec: ArraySpec) -> StoredArray:
        """Open one of the stage's arrays, which is created empty if it does not exist."""
        path = root / layout.RUNS / spec.path(self.run)
        return array_writer.create(path, self._layout(spec), dict(spec.attributes), root)

    def _layout(self, spec: ArraySpec) -> Layout:
        """Shards of many units, none much larger than the array."""
        if not self.is_aggregate and self.unit_rows >= spec.rows:
            return array_writer.plan_whole(spec.rows, spec.item, spec.dtype)
        unit = spec.rows if self.is_aggregate else self.unit_rows
        units = max(1, min(array_writer.SHARD_ROWS // unit, -(-spec.rows // unit)))
        return array_writer.plan_layout(spec.rows, spec.item, spec.dtype, units * unit, unit)

    def rendered_arrays(self, root: Path) -> Callable[[str, str], Any] | None:
        """Function that opens the source arrays of rendered frames; None if there are none."""
        kinds = set(FRAME_KINDS.values())
        if not any(spec.kind in kinds for spec in self.sources):
            return None
        return partial(self.source_array, root)

    def source_array(
        self, root: Path, kind: str, side: str | None, mode: str | None = None
    ) -> RowArray:
        """Open the array of a source; its rows are instances, from 0 on.

        What is fitted reads NaN for instances that were not computed.
        """
        specs = [
            spec
            for spec in self.sources
            if spec.kind == kind and spec.side in (side, None) and spec.mode == mode
        ]
        if not specs:
            raise KeyError(f"stage {self.name} has no source {kind} {side} {mode}")
        return open_parts(specs, root, self.run, fills_gaps=self.fitted > 0)

    def valid_instances(self, root: Path, instances: range) -> NDArray[np.bool_]:
        """Whether both sides predicted a pose, for each of `instances`, (n,)."""
        poses = [
            self.source_array(root, "prediction", side).rows(instances.start, instances.stop)
            for side in SIDES
        ]
        return np.asarray(np.isfinite(poses).all(axis=(0, 2)))


@dataclass(frozen=True, slots=True)
class WorkUnit:
    """A range of instances of a stage, and the arrays that are missing there."""

    stage: Stage
    number: int
    missing: tuple[ArraySpec, ...]

    @property
    def instances(self) -> range:
        return self.stage.unit_instances(self.number)


Compute = Callable[["UnitComputer", WorkUnit], Mapping[ArraySpec, NDArray[Any]]]
"""A function of a module, so that other processes can call it."""


def open_parts(
    specs: Sequence[ArraySpec], root: Path, run: str, fills_gaps: bool = False
) -> RowArray:
    """Arrays of one kind, side and mode as one array with a row per instance, from 0 on.

    `fills_gaps` is that of `PartedArray`.
    """
    ordered = sorted(specs, key=lambda spec: spec.first_iid)
    if len(ordered) == 1 and ordered[0].first_iid == 0:
        return ordered[0].open_array(root, run)
    parts = [(spec.first_iid, spec.open_array(root, run)) for spec in ordered]
    stop = max(spec.first_iid + spec.rows for spec in ordered)
    return PartedArray(parts, stop, f"run {run!r}: {ordered[0].kind}", fills_gaps)
