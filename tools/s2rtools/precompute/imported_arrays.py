"""Arrays of imported predictions and embeddings, in the place of those that a network computes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import array_writer
from s2rstore.files.ledger import Ledger, LedgerEntry
from s2rstore.reader import Store
from s2rstore.records import SIDES, Run, Side
from s2rtools.precompute.array_keys import content_key
from s2rtools.precompute.tasks.network_outputs import FORWARD_ROWS
from s2rtools.precompute.work_units import FORWARD, ArraySpec, Stage

_KINDS = ("prediction", "embedding")
_HASHED_ROWS = 8192


class InstanceRows(Protocol):
    """An array with a row per instance, of which ranges are read."""

    @property
    def shape(self) -> tuple[int, ...]: ...
    @property
    def dtype(self) -> np.dtype[Any]: ...
    def __getitem__(self, rows: slice, /) -> NDArray[Any]: ...


SideArrays = Mapping[Side, InstanceRows]


def imported_specs(
    iids: range, poses: SideArrays, embeddings: SideArrays, sigmas: SideArrays
) -> list[ArraySpec]:
    """The arrays of some instances, with a key of their values; `embeddings` may be empty.

    `poses` (N, 3) as of `write_arrays`, `embeddings` (N, D). `sigmas` (N,), which may be empty
    as well, have no array but are part of the key, so that it tells two imports apart.
    """
    digest = hashlib.sha256()
    for values in (*_by_side(poses), *_by_side(embeddings), *_by_side(sigmas)):
        digest.update(f"{values.dtype.str} {values.shape[1:]}".encode())
        for start in range(iids.start, iids.stop, _HASHED_ROWS):
            digest.update(values[start : min(start + _HASHED_ROWS, iids.stop)].tobytes())
    key = content_key({"kind": "prediction", "imported": digest.hexdigest()})
    described = [("prediction", poses, "x y heading", "m m rad")]
    if embeddings:
        described.append(("embedding", embeddings, "feature", ""))
    return [
        ArraySpec(
            kind, side, None, arrays[side].shape[1:], arrays[side].dtype.name, ("iid", axis), unit,
            key, len(iids), first_iid=iids.start,
        )
        for kind, arrays, axis, unit in described
        for side in SIDES
    ]  # fmt: skip


def write_arrays(
    root: Path, run: str, specs: Sequence[ArraySpec], poses: SideArrays, embeddings: SideArrays
) -> None:
    """Write the arrays of a segment durably; those that the ledger proves are left as they are.

    `poses` (N, 3): x and y in metres, heading in radians, NaN where there is no prediction.
    `embeddings` (N, D) are NaN there.
    """
    ledger, stage = Ledger(root), Stage(FORWARD, run, tuple(specs), FORWARD_ROWS)
    for spec in specs:
        side: Side = "sim" if spec.side == "sim" else "real"
        values = poses[side] if spec.kind == "prediction" else embeddings[side]
        array = stage.create(root, spec)
        known = ledger.array_entries(spec.folder(run))
        written = []
        for number in range(array.layout.shards):
            if array.file(number) in known and ledger.proves(known[array.file(number)]):
                continue
            count = array.rows_in(number)
            first = spec.first_iid + number * array.layout.shard_rows
            rows = values[first : first + count]
            file = array_writer.write_shard(array.path, number, rows, root)
            unit = f"{run}:imported:{number}"
            written.append(LedgerEntry(unit, file.path, file.bytes, file.sha256, count))
        ledger.add_array_entries(spec.folder(run), written)


def imported_stages(store: Store, run: Run) -> list[Stage]:
    """The published arrays of an import as stages that others are computed from, one a segment.

    Instances that were appended after the import have none.
    """
    grouped: dict[int, list[ArraySpec]] = {}
    for kind, side in product(_KINDS, SIDES):
        for record in store.array_parts(run.run):
            if (record.kind, record.side) == (kind, side):
                spec = ArraySpec(
                    record.kind, record.side, None, record.shape[1:], record.dtype, record.axes,
                    record.unit, record.path.split("/")[1], record.shape[0],
                    first_iid=record.first_iid,
                )  # fmt: skip
                grouped.setdefault(record.first_iid, []).append(spec)
    return [
        Stage(FORWARD, run.run, tuple(grouped[first]), FORWARD_ROWS) for first in sorted(grouped)
    ]


def _by_side(arrays: SideArrays) -> list[InstanceRows]:
    return [arrays[side] for side in SIDES if side in arrays]
