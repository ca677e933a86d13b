"""Tasks that run the network: predictions, embeddings and heatmaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store
from s2rstore.records import SIDES, Run
from s2rtools.heatmaps import HEATMAP_KINDS, PairBatch, SideBatch
from s2rtools.heatmaps.harmonization import ImageAlignment
from s2rtools.inference import Backend
from s2rtools.models.pose_network import LoadedModel
from s2rtools.precompute.frame_reader import PairFrames, SideFrames
from s2rtools.precompute.work_units import ArraySpec, Stage, content_key, run_dependencies

FORWARD_ROWS = 256
HEATMAP_ROWS = 64


def forward_stage(
    store: Store,
    run: Run,
    model: LoadedModel,
    backend: dict[str, Any],
    kinds: Sequence[str],
    frames: tuple[ArraySpec, ...] = (),
) -> Stage:
    """Predictions, embeddings and every heatmap kind that needs one forward pass only.

    `frames` are the arrays of rendered frames that the stage reads.
    """
    facts = run_dependencies(store, run, backend)
    key = content_key({**facts, "kind": "prediction"})
    n, size = len(store.instances), model.network.embedding_size
    specs = [
        ArraySpec(kind, side, None, item, dtype, ("iid", axis), unit, key, n)
        for kind, item, dtype, axis, unit in (
            ("prediction", (3,), "float64", "x y heading", "m m rad"),
            ("embedding", (size,), "float16", "feature", ""),
        )
        for side in SIDES
    ]
    for kind in kinds:
        if HEATMAP_KINDS[kind].cost == "forward":
            specs += _kind_specs(store, run, facts, kind, model)
    return Stage("forward", run.run, tuple(specs), FORWARD_ROWS, frames)


def heatmap_stages(
    store: Store,
    run: Run,
    model: LoadedModel,
    backend: dict[str, Any],
    kinds: Sequence[str],
    frames: tuple[ArraySpec, ...] = (),
) -> list[Stage]:
    """One stage per heatmap kind that needs many passes through the network."""
    facts = run_dependencies(store, run, backend)
    return [
        Stage(kind, run.run, tuple(_kind_specs(store, run, facts, kind, model)), HEATMAP_ROWS,
              frames)
        for kind in kinds
        if HEATMAP_KINDS[kind].cost != "forward"
    ]  # fmt: skip


def _kind_specs(
    store: Store, run: Run, facts: dict[str, Any], name: str, model: LoadedModel
) -> list[ArraySpec]:
    kind = HEATMAP_KINDS[name]
    if kind.aligned:
        correction = store.rig_offset(run.sim_domain, run.real_domain)
        facts = {**facts, "correction": correction and asdict(correction)}
    key = content_key({**facts, "kind": name, "version": kind.version, "params": kind.params})
    return [
        ArraySpec(name, out.side, out.mode, tuple(out.shape), out.dtype, ("iid", *out.axes),
                  out.unit, key, len(store.instances), tuple(sorted(out.attributes.items())))
        for out in kind.outputs(model)
    ]  # fmt: skip


def pair_batch(
    store: Store,
    backend: Backend,
    iid: int,
    frames: PairFrames,
    aligned: ImageAlignment | None = None,
) -> PairBatch:
    """Both sides of a batch after the forward pass; its first instance is `iid`."""
    rows = slice(iid, iid + len(frames["sim"].x))
    truth = store.instances
    poses = np.stack([truth.x[rows], truth.y[rows], truth.heading[rows]], axis=1)
    sim, real = (side_batch(backend, frames[side], poses) for side in SIDES)
    return PairBatch(backend.model, backend, sim, real, aligned)


def side_batch(backend: Backend, frames: SideFrames, poses: NDArray[np.float64]) -> SideBatch:
    """One side after the forward pass; `poses` (B, 3) are the true poses."""
    forward = backend.forward_all(frames.x)
    return SideBatch(
        x=forward.x,
        rgb=frames.rgb,
        depth=frames.depth,
        valid=frames.valid,
        depth_scale=frames.depth_scale,
        features=forward.features,
        embedding=forward.embedding,
        prediction=forward.pose,
        truth=poses,
    )


def pair_values(pair: PairBatch, specs: tuple[ArraySpec, ...]) -> dict[ArraySpec, NDArray[Any]]:
    """Values of a batch for each array: predictions, embeddings and heatmaps."""
    values: dict[ArraySpec, NDArray[Any]] = {}
    computed: dict[str, Any] = {}
    for spec in specs:
        if spec.kind == "prediction":
            values[spec] = np.asarray(pair.side(spec.side).prediction, dtype=np.float64)
        elif spec.kind == "embedding":
            values[spec] = as_stored(np.asarray(pair.side(spec.side).embedding), spec.dtype)
        else:
            if spec.kind not in computed:
                computed[spec.kind] = HEATMAP_KINDS[spec.kind].compute(pair)
            values[spec] = as_stored(computed[spec.kind][spec.side, spec.mode], spec.dtype)
    return values


def as_stored(values: NDArray[Any], dtype: str) -> NDArray[Any]:
    """Values in the dtype of their array; values beyond float16 are clipped, NaN stays."""
    if dtype != "float16":
        return values.astype(dtype)
    limit = np.finfo(np.float16).max
    return np.clip(values, -limit, limit).astype(np.float16)
