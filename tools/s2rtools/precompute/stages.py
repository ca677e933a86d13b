"""The stages of a run: forward passes, occlusion, projection, map grids, outliers; their keys."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from s2rstore.geometry import floor_grid as map_geometry
from s2rstore.geometry.camera_offset import UNMOVED
from s2rstore.reader import Store
from s2rstore.records import SIDES, Run
from s2rstore.run_inputs import FRAME_KINDS, run_move
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtools.models.pose_network import LoadedModel
from s2rtools.precompute.tasks import outliers
from s2rtools.precompute.tasks.umap_projection import SETTINGS
from s2rtools.precompute.work_units import ArraySpec, Stage, content_key, run_dependencies
from s2rtools.rendering import renderer_version

FRAME_ROWS = 32
FORWARD_ROWS = 256
OCCLUSION_ROWS = 64
OUTLIER_ROWS = 32_768
MAP_SETTINGS: dict[str, Any] = {"cells": 264, "heights": [0.1, 2.0], "version": 1}


def frames_stages(store: Store, run: Run) -> list[Stage]:
    """One stage for the sides whose cameras are moved; none where no side's are."""
    specs = []
    for side in SIDES:
        domain, move = store.domain(run.domain(side)), run_move(store, run, side)
        if move == UNMOVED:
            continue
        depth = store.frames(domain.domain, 0, 1, ("depth",))["depth"].dtype.name
        frame = store.dataset.frame_height, store.dataset.frame_width
        facts = {
            "dataset": store.dataset.hash,
            "domain": domain.domain,
            "move": asdict(move),
            "renderer": renderer_version(store),
        }
        key = content_key({**facts, "kind": "frames"})
        n, axes = len(store.instances), ("iid", "row", "column")
        specs += [
            ArraySpec(FRAME_KINDS["rgb"], side, None, (*frame, 3), "uint8", (*axes, "channel"), "",
                      key, n),
            ArraySpec(FRAME_KINDS["depth"], side, None, frame, depth, axes, "raw", key, n),
        ]  # fmt: skip
    return [Stage("frames", run.run, tuple(specs), FRAME_ROWS)] if specs else []


def forward_stage(
    store: Store,
    run: Run,
    model: LoadedModel,
    backend: dict[str, Any],
    kinds: Sequence[str],
    frames: tuple[ArraySpec, ...] = (),
) -> Stage:
    """Predictions, embeddings and every heatmap kind that needs no more than a forward pass.

    `frames` are the arrays of rendered frames that it reads.
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


def occlusion_stages(
    store: Store,
    run: Run,
    model: LoadedModel,
    backend: dict[str, Any],
    kinds: Sequence[str],
    frames: tuple[ArraySpec, ...] = (),
) -> list[Stage]:
    """One stage per heatmap kind that recomputes the network many times."""
    facts = run_dependencies(store, run, backend)
    return [
        Stage(kind, run.run, tuple(_kind_specs(store, run, facts, kind, model)), OCCLUSION_ROWS,
              frames)
        for kind in kinds
        if HEATMAP_KINDS[kind].cost != "forward"
    ]  # fmt: skip


def _kind_specs(
    store: Store, run: Run, facts: dict[str, Any], name: str, model: LoadedModel
) -> list[ArraySpec]:
    kind = HEATMAP_KINDS[name]
    if kind.aligned:
        correction = store.correction(run.sim_domain, run.real_domain)
        facts = {**facts, "correction": correction and asdict(correction)}
    key = content_key({**facts, "kind": name, "version": kind.version, "params": kind.params})
    return [
        ArraySpec(name, out.side, out.mode, tuple(out.shape), out.dtype, ("iid", *out.axes),
                  out.unit, key, len(store.instances), tuple(sorted(out.attributes.items())))
        for out in kind.outputs(model)
    ]  # fmt: skip


def projection_stage(store: Store, forward: Stage) -> Stage:
    """PCA and joint UMAP of the forward stage's embeddings: one unit."""
    n = len(store.instances)
    embedding = next(spec for spec in forward.specs if spec.kind == "embedding")
    key = content_key({"embedding": embedding.key, **SETTINGS.facts()})
    specs = [
        ArraySpec(kind, side, None, (width,), "float32", ("iid", axis), "", key, n)
        for kind, width, axis in (("pca", SETTINGS.components, "component"), ("umap", 2, "u v"))
        for side in SIDES
    ]
    sources = _of_kind(forward, "prediction") + _of_kind(forward, "embedding")
    return Stage("projection", forward.run, tuple(specs), max(n, 1), sources)


def outlier_stage(store: Store, forward: Stage, projection: Stage) -> Stage:
    """Distances to the nearest principal components of the same side."""
    n = len(store.instances)
    components = _of_kind(projection, "pca")
    key = content_key({"pca": components[0].key, **outliers.SETTINGS.facts()})
    specs = [
        ArraySpec(outliers.KIND, side, None, (), "float32", ("iid",), "", key, n) for side in SIDES
    ]
    sources = _of_kind(forward, "prediction") + components
    return Stage("outlier", forward.run, tuple(specs), OUTLIER_ROWS, sources)


def _of_kind(stage: Stage, kind: str) -> tuple[ArraySpec, ...]:
    return tuple(spec for spec in stage.specs if spec.kind == kind)


def map_stages(store: Store, forward: Stage, others: Sequence[Stage]) -> list[Stage]:
    """Back-projected grids of every heatmap of the given stages, one stage per kind and side."""
    grid = map_geometry.MapGrid(store.dataset.bounds, MAP_SETTINGS["cells"])
    predictions = _of_kind(forward, "prediction")
    stages = []
    for stage in (forward, *others):
        for kind in dict.fromkeys(spec.kind for spec in stage.specs if spec.kind in HEATMAP_KINDS):
            heat = _of_kind(stage, kind)
            for side in SIDES:
                specs = [
                    _map_spec(spec, side, mode, (grid.rows, grid.cols))
                    for spec in heat
                    if spec.side in (side, None)
                    for mode in HEATMAP_KINDS[kind].planes or (spec.mode,)
                ]
                stages.append(
                    Stage(f"map:{kind}:{side}", stage.run, tuple(specs),
                          len(map_geometry.AGGREGATES), predictions + heat + forward.sources)
                )  # fmt: skip
    return stages


def _map_spec(spec: ArraySpec, side: str, mode: str | None, shape: tuple[int, int]) -> ArraySpec:
    surface = (
        {"surface": HEATMAP_KINDS[spec.kind].surface} if HEATMAP_KINDS[spec.kind].aligned else {}
    )
    key = content_key({"heat": spec.key, **MAP_SETTINGS, **surface})
    names = ",".join(map_geometry.AGGREGATES)
    return ArraySpec(
        f"map:{spec.kind}", side, mode, shape, "float32", ("aggregate", "row", "column"),
        spec.unit, key, len(map_geometry.AGGREGATES), (("aggregates", names),),
    )  # fmt: skip
