"""Tasks that run the network: predictions, embeddings and heatmaps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import torch
from numpy.typing import NDArray

from s2rstore.reader import Store
from s2rstore.records import SIDES, Run, Side
from s2rtools.counterfactual import gap_shares
from s2rtools.counterfactual.factor_composites import FACTORS
from s2rtools.heatmaps import HEATMAP_KINDS, HeatmapKind, PairBatch, SideBatch, harm
from s2rtools.heatmaps.harmonization import ImageAlignment
from s2rtools.heatmaps.heatmap_method import OutputSpec
from s2rtools.inference import Backend, ForwardOutput
from s2rtools.models.input_contract import InputContract
from s2rtools.models.pose_network import LoadedModel
from s2rtools.precompute.array_keys import ArrayKeys
from s2rtools.precompute.domain_calibration import load_alignment
from s2rtools.precompute.frame_reader import PairFrames, RunFrames, SideFrames, read_pairs
from s2rtools.precompute.run_backends import RunBackends
from s2rtools.precompute.unit_computer import UnitComputer
from s2rtools.precompute.work_units import FORWARD, ArraySpec, Stage, WorkUnit

DEPTH_MODES = ("depth", "rgbd")
"""Modes of heatmaps that need depth on both sides."""
FORWARD_ROWS = 256
HEATMAP_ROWS = 64
SMALL_ROWS = 16
_SMALL_PART = 2048
"""Instances up to which units are so small that all processes finish at about the same time."""
_DESCRIBED: WeakKeyDictionary[Any, dict[tuple[str, str, InputContract], Any]] = WeakKeyDictionary()
"""Outputs and attributes of heatmap kinds by network, for each of its input contracts."""


def network_stages(
    keys: ArrayKeys,
    run: Run,
    iids: range,
    model: LoadedModel,
    backends: RunBackends,
    kinds: Sequence[str],
    frames: tuple[ArraySpec, ...] = (),
    has_depth: bool = True,
) -> tuple[Stage, list[Stage]]:
    """The forward stage of some pairs, and the stages of heatmap kinds that need many passes.

    The forward stage computes predictions, embeddings, every heatmap kind that needs one pass
    only, and those that go on from that pass. The shares of the gap belong to the stage of the
    harm kinds. `frames` are the arrays of rendered frames that the stages read. `has_depth` tells
    whether both domains have depth.
    """
    rendered = [spec.key for spec in frames]
    key = keys.prediction(backends.predictions.facts(), rendered)
    size = model.network.embedding_size
    specs = [_prediction_spec(iids, side, key) for side in SIDES]
    specs += [
        ArraySpec("embedding", side, None, (size,), "float16", ("iid", "feature"), "", key,
                  len(iids), first_iid=iids.start)
        for side in SIDES
    ]  # fmt: skip
    grouped: dict[str, list[ArraySpec]] = {}
    for kind in kinds:
        described = _described(HEATMAP_KINDS[kind], model, backends.differences or "float32")
        key_of_kind = keys.heatmap(kind, backends.kind_facts(kind), rendered)
        heatmaps = heatmap_specs(iids, kind, *described, *key_of_kind, has_depth)
        reuses = backends.heatmaps_reuse_activations and HEATMAP_KINDS[kind].uses_base(described[1])
        if HEATMAP_KINDS[kind].cost == "forward" or reuses:
            specs += heatmaps
        else:
            grouped.setdefault(HEATMAP_KINDS[kind].stage or kind, []).extend(heatmaps)
    if harm.STAGE in grouped:
        facts = backends.kind_facts(gap_shares.KIND)
        grouped[harm.STAGE].append(_share_spec(iids, keys.gap_shares(facts, rendered)))
    heat_rows = SMALL_ROWS if len(iids) <= _SMALL_PART else HEATMAP_ROWS
    stages = [
        Stage(name, run.run, tuple(of_stage), heat_rows, frames, compute=compute_outputs)
        for name, of_stage in grouped.items()
    ]
    rows = heat_rows if backends.predictions.keeps_activations else FORWARD_ROWS
    forward = Stage(FORWARD, run.run, tuple(specs), rows, frames, compute=compute_outputs)
    return forward, stages


def one_sided_stage(
    keys: ArrayKeys,
    run: Run,
    iids: range,
    side: Side,
    backends: RunBackends,
    frames: tuple[ArraySpec, ...] = (),
) -> Stage:
    """The forward stage of instances with images of one side alone: their predictions."""
    key = keys.prediction(backends.predictions.facts(), [spec.key for spec in frames])
    specs = (_prediction_spec(iids, side, key),)
    return Stage(FORWARD, run.run, specs, FORWARD_ROWS, frames, compute=compute_outputs)


def _prediction_spec(iids: range, side: Side, key: str) -> ArraySpec:
    """The array of the poses (x, y, heading) that a side predicts for some instances."""
    return ArraySpec("prediction", side, None, (3,), "float64", ("iid", "x y heading"), "m m rad",
                     key, len(iids), first_iid=iids.start)  # fmt: skip


def _share_spec(iids: range, key: str) -> ArraySpec:
    """The array of the shares of the gap of some instances."""
    item, axes = (len(FACTORS),), ("iid", "factor")
    return ArraySpec(gap_shares.KIND, None, None, item, "float32", axes, "m", key, len(iids),
                     first_iid=iids.start)  # fmt: skip


def _described(
    kind: HeatmapKind, model: LoadedModel, differences: str
) -> tuple[list[OutputSpec], dict[str, str]]:
    """Outputs and attributes of a kind; found once for a network, which has to run for them."""
    known = _DESCRIBED.setdefault(model.network, {})
    key = kind.name, differences, model.contract
    if key not in known:
        known[key] = kind.outputs(model), kind.attributes(model, differences)
    return known[key]


def heatmap_specs(
    iids: range,
    name: str,
    outputs: Sequence[OutputSpec],
    attributes: Mapping[str, str],
    key: str,
    is_shared: bool,
    has_depth: bool,
) -> list[ArraySpec]:
    """The arrays of a heatmap kind for some instances, for its `outputs`.

    Without depth on both sides, those of modes that compare depth are left out.
    """
    return [
        ArraySpec(name, out.side, out.mode, tuple(out.shape), out.dtype, ("iid", *out.axes),
                  out.unit, key, len(iids), tuple(sorted(attributes.items())),
                  iids.start, is_shared)
        for out in outputs if has_depth or out.mode not in DEPTH_MODES
    ]  # fmt: skip


def imaged_sides(store: Store, run: Run, iids: range) -> list[Side]:
    """The sides of a run of which instances have images; all of `iids` have the same."""
    return [side for side in SIDES if store.is_imaged(run.domain(side), iids.start)]


def compute_outputs(computer: UnitComputer, unit: WorkUnit) -> dict[ArraySpec, NDArray[Any]]:
    """Predictions, embeddings and heatmaps of a unit's instances.

    Of the images of one side alone there are predictions only.
    """
    store, run = computer.store, computer.store.run(unit.stage.run)
    backend, heatmap_backend = computer.backends(run)
    alignment = load_alignment(store, run)
    truth = {side: store.poses(run.domain(side)) for side in SIDES}
    source = RunFrames(store, run, unit.stage.rendered_arrays(store.path))
    rows, contract = unit.instances, backend.model.contract
    sides = imaged_sides(store, run, rows)
    batches: dict[ArraySpec, list[NDArray[Any]]] = {spec: [] for spec in unit.missing}
    for iid, frames in read_pairs(
        store, run, contract, rows.start, rows.stop, backend.batch, source, sides
    ):
        of_batch = slice(iid, iid + len(frames[sides[0]].x))
        poses = {side: truth[side][of_batch] for side in SIDES}
        values = _batch_values(backend, heatmap_backend, frames, poses, alignment, unit.missing)
        for spec, part in batches.items():
            part.append(as_stored(values[spec], spec.dtype))
    return {spec: np.concatenate(parts) for spec, parts in batches.items()}


def _batch_values(
    backend: Backend,
    heatmap_backend: Backend,
    frames: PairFrames,
    truth: Mapping[Side, NDArray[np.float64]],
    alignment: ImageAlignment | None,
    specs: Sequence[ArraySpec],
) -> dict[ArraySpec, NDArray[Any]]:
    """The values of `specs` for a batch; activations that the passes kept are freed at the end.

    `backend` computes predictions and embeddings, `heatmap_backend` what heatmaps are made of.
    """
    kinds = {spec.kind for spec in specs} & set(HEATMAP_KINDS)
    is_shared = any(spec.kind == gap_shares.KIND for spec in specs)
    outputs: dict[Side, ForwardOutput] = {}
    if any(spec.kind in ("prediction", "embedding") for spec in specs):
        outputs = {side: backend.forward_all(of_side.x) for side, of_side in frames.items()}
    heatmaps: dict[str, Any] = {}
    if kinds or is_shared:
        given = outputs if heatmap_backend is backend else {}
        uses_features = any(HEATMAP_KINDS[kind].uses_features for kind in kinds)
        sim, real = (
            side_batch(heatmap_backend, frames[side], truth[side], given.get(side), uses_features)
            for side in SIDES
        )
        predictor = backend if backend.is_float32 else None
        pair = PairBatch(heatmap_backend.model, heatmap_backend, sim, real, alignment, predictor)
        heatmaps = {kind: HEATMAP_KINDS[kind].compute(pair) for kind in kinds}
        if is_shared:
            heatmaps[gap_shares.KIND] = {(None, None): _gap_shares(pair)}
    values: dict[ArraySpec, NDArray[Any]] = {}
    for spec in specs:
        if spec.kind in ("prediction", "embedding"):
            output = outputs["sim" if spec.side == "sim" else "real"]
            is_pose = spec.kind == "prediction"
            values[spec] = output.pose if is_pose else output.embedding.cpu().numpy()
        else:
            values[spec] = heatmaps[spec.kind][spec.side, spec.mode]
    return values


def _gap_shares(pair: PairBatch) -> NDArray[np.float64]:
    """Shares of the gap (B, 5) of a batch in metres."""
    return np.stack([
        gap_shares.gap_shares(pair.pose_backend, composites, truth)
        for composites, truth in zip(pair.composites(), pair.real.truth, strict=True)
    ])  # fmt: skip


def side_batch(
    backend: Backend,
    frames: SideFrames,
    poses: NDArray[np.float64],
    forward: ForwardOutput | None = None,
    features: bool = True,
) -> SideBatch:
    """One side after the forward pass; `poses` (B, 3) are the true poses.

    Without `features`, the pass is left out where it was not given as `forward`.
    """
    if forward is None:
        forward = backend.forward_all(frames.x) if features else backend.input_only(frames.x)
    return SideBatch(
        x=forward.x,
        rgb=frames.rgb,
        depth=frames.depth,
        valid=frames.valid,
        depth_scale=frames.domain.depth_scale,
        features=forward.features,
        embedding=forward.embedding,
        prediction=forward.pose,
        truth=poses,
        base=forward.base,
    )


def as_stored(values: NDArray[Any], dtype: str) -> NDArray[Any]:
    """Values in the dtype of their array; values beyond float16 are clipped, NaN stays."""
    if dtype != "float16":
        return values.astype(dtype)
    limit = float(np.finfo(np.float16).max)
    if values.dtype != np.float32:
        return np.clip(values, -limit, limit).astype(np.float16)
    exact = torch.from_numpy(np.ascontiguousarray(values))
    return exact.clamp(-limit, limit).to(torch.float16).numpy()  # several times as fast as numpy
