"""Publish a computed run: write its index rows as a new generation."""

from __future__ import annotations

import json
import platform
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.documents import parse_object
from s2rstore.files.ledger import Ledger
from s2rstore.index.schema import GAP_SHARES
from s2rstore.index.transaction import IndexTransaction, edit
from s2rstore.reader import Store
from s2rstore.records import SIDES, ArrayRecord, Run
from s2rtools.common.blocks import evenly_spread
from s2rtools.counterfactual import gap_shares
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtools.precompute.array_keys import content_key
from s2rtools.precompute.prediction_rows import (
    NOT_ATTEMPTED,
    decode_split,
    prediction_columns,
    ranked_instances,
)
from s2rtools.precompute.run_backends import RunBackends
from s2rtools.precompute.tasks import outliers
from s2rtools.precompute.tasks.umap_projection import SETTINGS
from s2rtools.precompute.unit_plan import recorded_environments
from s2rtools.precompute.work_units import ArraySpec, Stage, open_parts

ARRAY_FACTS = "arrays"
"""Key of a run's provenance: for each array key, what computed it."""
_RANGE_ROWS = 512
_PACKAGES = ("s2rtui", "torch", "numpy", "zarr", "duckdb", "umap-learn", "scikit-learn")


def publish_run(
    store: Store,
    planned: Run,
    stages: Sequence[Stage],
    backends: RunBackends | None,
    check: Callable[[], None] = lambda: None,
    earlier: Collection[str] = (),
) -> int | None:
    """Publish a run whose stages are complete; the new generation, None if the index is up to date.

    `planned` is the run as the stages were planned. `backends` is None for imported predictions,
    which may cover the first parts only. `check` is called before anything is published, see
    `edit`. Arrays of other heatmap kinds stay listed as long as they belong to the same
    predictions: those of the stages, or those of fewer instances at the `earlier` paths. Raises
    RequestError where the run was removed or registered anew meanwhile.
    """
    run = planned.run
    specs = [spec for stage in stages for spec in stage.specs]
    key = run_key(specs)
    predicted = {spec.path(run) for spec in specs if spec.kind == "prediction"}
    if backends is not None and not _are_all_predicted(store, planned, specs):
        raise RequestError(f"{store.path}: instances were added meanwhile; run the command again")
    listed = store.array_parts(run)
    same = any(
        record.kind == "prediction" and record.path in predicted.union(earlier) for record in listed
    )
    if backends is None and not same:
        raise RequestError(f"run {run!r}: was imported again meanwhile; run the command again")
    listed = listed if same else []
    if _are_listed(store, run, specs, listed):
        return None
    root = store.path
    keeps_shares = any(record.kind == gap_shares.KIND for record in listed)
    columns = list(_instance_columns(store, planned, specs, keeps_shares))
    known = {record.path for record in listed}
    added = {spec.kind for spec in specs if spec.path(run) not in known}
    ranges = _heat_ranges(store, run, [spec for spec in specs if spec.kind in added])
    previous = store.provenance(f"run:{run}") if same else {}
    computed = {(spec.kind, spec.side, spec.mode) for spec in specs}
    other_arrays = [r for r in listed if (r.kind, r.side, r.mode) not in computed]
    with edit(root, check) as draft:
        _check_registered(draft, planned)
        if backends is None:
            _check_not_imported_again(draft, run, predicted)
        for table in ("prediction", "projection", "zarr_array"):
            draft.delete(table, run=run)
        for table, rows in columns:
            draft.insert(table, rows)
        draft.insert_rows("zarr_array", [asdict(record) for record in other_arrays])
        draft.insert_rows("zarr_array", [array_row(root, run, spec) for spec in specs])
        if backends is not None:
            precision = backends.predictions.precision
            draft.update("run", {"run": run}, {"key": key, "precision": precision})
        facts = _provenance(root, run, specs, backends, ranges, previous)
        keys = {spec.key for spec in specs} | {r.path.split("/")[1] for r in other_arrays}
        facts[ARRAY_FACTS] = {key: each for key, each in facts[ARRAY_FACTS].items() if key in keys}
        draft.set_provenance(f"run:{run}", facts)
    return draft.generation


def _are_all_predicted(store: Store, run: Run, specs: Sequence[ArraySpec]) -> bool:
    """Whether there are as many predictions of each side as images."""
    return all(
        sum(spec.rows for spec in specs if (spec.kind, spec.side) == ("prediction", side))
        == np.count_nonzero(store.imaged(run.domain(side)))
        for side in SIDES
    )


def _check_registered(draft: IndexTransaction, run: Run) -> None:
    """Raise RequestError unless the run has the model, domains and adjustments of `run`."""
    names = ("model", "sim_domain", "real_domain", "sim_adjustments", "real_adjustments")
    rows = draft.rows(f"SELECT {', '.join(names)} FROM run WHERE run = ?", [run.run])
    registered = [(*row[:3], *map(json.loads, row[3:])) for row in rows]
    if registered != [tuple(getattr(run, name) for name in names)]:
        raise RequestError(
            f"run {run.run!r}: was removed or registered anew meanwhile; run the command again"
        )


def _check_not_imported_again(draft: IndexTransaction, run: str, predicted: set[str]) -> None:
    """Raise RequestError where the run has other imported predictions by now."""
    query = "SELECT path FROM zarr_array WHERE run = ? AND kind = 'prediction'"
    if {path for (path,) in draft.rows(query, [run])} != predicted:
        raise RequestError(f"run {run!r}: was imported again meanwhile; run the command again")


def _are_listed(
    store: Store, run: str, specs: Sequence[ArraySpec], listed: Sequence[ArrayRecord]
) -> bool:
    """Whether the index lists all arrays as they are in the store, and what computed them."""
    if ARRAY_FACTS in store.provenance(f"run:{run}"):
        facts = store.provenance_object(f"run:{run}", ARRAY_FACTS)
        if not facts.keys() >= {spec.key for spec in specs}:
            return False
    checksums = {record.path: record.metadata_sha256 for record in listed}
    if not checksums.keys() >= {spec.path(run) for spec in specs}:
        return False
    return all(
        checksums[spec.path(run)] == spec.open_array(store.path, run).metadata_sha256
        for spec in specs
    )


def run_key(specs: Sequence[ArraySpec]) -> str:
    """The key of the predictions of all parts; instances of one side do not change it."""
    predictions = [spec for spec in specs if spec.kind == "prediction"]
    sides = Counter(spec.key for spec in predictions)
    keys = [key for key, count in sides.items() if count == len(SIDES)] or list(sides)
    return keys[0] if len(keys) == 1 else content_key({"parts": keys})


def _instance_columns(
    store: Store, record: Run, specs: Sequence[ArraySpec], keeps_shares: bool
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Columns of the tables `prediction` and `projection`, each with its table.

    Imported predictions may be those of the first parts alone, and without embeddings; their
    published sigmas stay, which no array has. A model is not applied to instances that the domain
    of the side does not image. With `keeps_shares`, published shares of the gap stay where `specs`
    have none.
    """
    run = record.run
    splits = store.provenance(f"run:{run}" if record.is_imported else f"model:{record.model}")
    n = len(store.instances)
    shares = _gap_shares(store, run, specs, keeps_shares)
    arrays_of = {
        side: {
            kind: _of_instances(of_kind, store.path, run, 0 if record.is_imported else n)
            for kind in ("prediction", outliers.KIND, "umap")
            if (of_kind := [s for s in specs if (s.kind, s.side) == (kind, side)])
        }
        for side in SIDES
    }
    ranked = ranked_instances(
        store.imaged(record.sim_domain, record.real_domain),
        *(arrays["prediction"] for arrays in arrays_of.values()),
    )
    for side, arrays in arrays_of.items():
        split = decode_split(splits.get(f"split:{record.domain(side)}"), n)
        if not record.is_imported:
            split[~store.imaged(record.domain(side))] = NOT_ATTEMPTED
        poses = arrays["prediction"]
        scores = np.full(len(poses), np.nan)
        if outliers.KIND in arrays:
            scores = outliers.outlier_scores(arrays[outliers.KIND])
        sigmas = None
        if record.is_imported:
            sigmas = store.run_columns(run).side(side).sigma[: len(poses)]
        columns = prediction_columns(
            run, side, poses, store.poses(record.domain(side)), store.dataset.accuracy_scale, split,
            scores, ranked, shares if side == "real" else None, sigmas,
        )  # fmt: skip
        yield "prediction", columns
        if "umap" in arrays:
            u, v = arrays["umap"].astype(np.float64).T
            yield "projection", {**{k: columns[k] for k in ("run", "iid", "side")}, "u": u, "v": v}


def _of_instances(specs: Sequence[ArraySpec], root: Path, run: str, least: int) -> NDArray[Any]:
    """Read arrays of one kind and side as one, with NaN rows for instances that none of them has.

    The result has at least `least` rows.
    """
    rows = open_parts(specs, root, run).filled()
    padding = [(0, max(0, least - len(rows))), *[(0, 0)] * (rows.ndim - 1)]
    return np.pad(rows, padding, constant_values=np.nan)


def _gap_shares(
    store: Store, run: str, specs: Sequence[ArraySpec], keeps: bool
) -> NDArray[np.float32] | None:
    """The shares (n, 5) of the gap in metres: those of `specs`, else with `keeps` the published.

    NaN for pairs more than 2 cm or 0.5 degrees apart, whose images differ by more than the factors.
    """
    parts = [spec for spec in specs if spec.kind == gap_shares.KIND]
    if parts:
        shares = _of_instances(parts, store.path, run, len(store.instances)).astype(np.float32)
    elif keeps:
        real = store.run_columns(run).real
        shares = np.stack([getattr(real, name) for name in GAP_SHARES], axis=1).astype(np.float32)
    else:
        return None
    shares[~store.comparable_pairs] = np.nan
    return shares


def array_row(root: Path, run: str, spec: ArraySpec) -> dict[str, Any]:
    """The row of an array of a run in table `zarr_array`."""
    return {
        "run": run,
        "kind": spec.kind,
        "side": spec.side,
        "mode": spec.mode,
        "path": spec.path(run),
        "dtype": spec.dtype,
        "shape": [spec.rows, *spec.item],
        "axes": list(spec.axes),
        "scale": 1.0,
        "zero": 0.0,
        "unit": spec.unit,
        "metadata_sha256": spec.open_array(root, run).metadata_sha256,
        "first_iid": spec.first_iid,
    }


def _heat_ranges(store: Store, run: str, specs: Sequence[ArraySpec]) -> dict[str, list[float]]:
    """1st and 99th percentile of every heatmap kind and mode over both sides.

    Computed over at most `_RANGE_ROWS` instances, evenly spread over all parts.
    """
    parts: dict[str, list[np.ndarray]] = {}
    heatmaps = [spec for spec in specs if spec.kind in HEATMAP_KINDS]
    count = max((spec.first_iid + spec.rows for spec in heatmaps), default=0)
    iids = evenly_spread(count, _RANGE_ROWS)
    for spec in heatmaps:
        rows = iids[(iids >= spec.first_iid) & (iids < spec.first_iid + spec.rows)] - spec.first_iid
        values = np.asarray(spec.open_array(store.path, run).at(rows), dtype=np.float32)
        modes = HEATMAP_KINDS[spec.kind].planes
        for number, mode in enumerate(modes or (spec.mode,)):
            name = ":".join(part for part in (spec.kind, mode) if part)
            plane = values[:, number] if values.ndim == 4 else values
            parts.setdefault(name, []).append(plane[np.isfinite(plane)])
    return {
        name: [round(float(v), 6) for v in np.percentile(np.concatenate(planes), [1, 99])]
        for name, planes in parts.items() if sum(map(len, planes))
    }  # fmt: skip


def _environments(
    root: Path, run: str, specs: Sequence[ArraySpec], previous: dict[str, str]
) -> dict[str, Any]:
    """For each array key, the device, precision, threads and library versions that computed it.

    A list of several for merged arrays; None where none is recorded, as of imported arrays.
    """
    known = parse_object(previous.get(ARRAY_FACTS, "{}"), ARRAY_FACTS)
    folders = {spec.key: spec.folder(run) for spec in specs if spec.key not in known}
    return known | {key: _environment(root, folder) for key, folder in folders.items()}


def _environment(root: Path, folder: str) -> dict[str, Any] | list[dict[str, Any]] | None:
    """What the ledger states of the arrays in a folder of runs.zarr; None where it is nothing."""
    ledger = Ledger(root)
    found = recorded_environments(ledger, ledger.array_entries(folder).values())
    facts: list[dict[str, Any]] = [msgspec.to_builtins(environment) for environment in found]
    for each in facts:
        each["libraries"] = each.pop("versions")
    return facts if len(facts) > 1 else next(iter(facts), None)


def _provenance(
    root: Path,
    run: str,
    specs: Sequence[ArraySpec],
    backends: RunBackends | None,
    ranges: dict[str, list[float]],
    previous: dict[str, str],
) -> dict[str, Any]:
    """Provenance of a run; entries of `previous` for kinds that stay listed are retained."""
    facts: dict[str, Any] = {
        "heat ranges": parse_object(previous.get("heat ranges", "{}"), "heat ranges") | ranges,
        "projection": asdict(SETTINGS),
        "outlier": asdict(outliers.SETTINGS),
        "python": platform.python_version(),
        "packages": {name: metadata.version(name) for name in _PACKAGES},
        ARRAY_FACTS: _environments(root, run, specs, previous),
    }
    if backends is not None:
        facts["backend"] = backends.record()
    kinds = sorted({spec.kind for spec in specs} & set(HEATMAP_KINDS))
    surfaces = {kind: HEATMAP_KINDS[kind].surface for kind in kinds if HEATMAP_KINDS[kind].aligned}
    facts["surfaces"] = parse_object(previous.get("surfaces", "{}"), "surfaces") | surfaces
    for spec in specs:
        for name, value in spec.attributes:
            if name == "method":
                facts[f"{spec.kind} method"] = value
    return facts
