"""Heatmap `occlusion`: change of the error if a patch is replaced by the other side's."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Literal, Protocol
from weakref import WeakKeyDictionary

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from s2rstore.geometry import angles
from s2rstore.records import SIDES, Side
from s2rtools.heatmaps.heatmap_method import HeatArrays, HeatmapKind, OutputSpec, PairBatch, Ray
from s2rtools.incremental_inference import (
    BaseOutputs,
    DifferenceGraph,
    LocalGraph,
    PixelRegion,
    cut_patches,
    local_cost,
    non_local_reason,
)
from s2rtools.inference import Backend
from s2rtools.inference.trunk_rewriting import fold_batch_norm
from s2rtools.models.pose_network import LoadedModel, PoseNetwork

_MODES: dict[str, tuple[Mode, ...]] = {
    "rgb": ("rgb",), "depth": ("depth",), "rgbd": ("rgb", "depth", "rgbd"),
}  # fmt: skip
"""What can be replaced, by the channels of a network's input."""
_BY_LOCALITY = "by locality"
_BATCH = 8
_PIXELS_AT_ONCE = 32 * 128 * 128
_PIXELS_AT_ONCE_ON_GPU = 128 * 128 * 128

Mode = Literal["rgb", "depth", "rgbd"]
Poses = tuple[NDArray[np.float64], NDArray[np.float64]]
_OTHER: dict[Side, Side] = {"sim": "real", "real": "sim"}


class Recompute(Protocol):
    """Poses (N, 3) of unchanged inputs (N, C, h, w), and (N, P, M, 3) with patches of the others.

    `base` are the outputs of all operations for the unchanged inputs, None where they are not kept.
    """

    def __call__(
        self,
        backend: Backend,
        inputs: Tensor,
        others: Tensor,
        patches: list[PixelRegion],
        *,
        base: BaseOutputs | None = None,
    ) -> Poses: ...


_METHODS: WeakKeyDictionary[Backend, tuple[str, Recompute]] = WeakKeyDictionary()


class Occlusion(HeatmapKind):
    """Replace each of 6 x 6 patches of one side's input by the other side's patch.

    Modes `rgb`, `depth` and `rgbd` replace the colours, depth or both; a network without one of
    them has its own mode alone. Plane 0 in metres, plane 1 in degrees of heading. Real input: error
    before - after; sim input: error after - before; so values > 0 mark where the gap arises.
    Computed in float32 torch. The network is recomputed locally where the trunk allows it and a
    count of operations says that this saves time, else in full. A run may compute the differences
    that the patches cause in bfloat16: their error is then relative to the effect. The attribute
    `method` names the way. Source: Zeiler and Fergus, "Visualizing and understanding convolutional
    networks", 2014, with the exchange of patches of Sim2RealViz, section 4.4.
    """

    name = "occlusion"
    params = {"patches": 6}  # noqa: RUF012
    cost = "hundreds"
    sums_to_metres = True

    def outputs(self, model: LoadedModel) -> list[OutputSpec]:
        count = self.params["patches"]
        return [
            OutputSpec(side, mode, (2, count, count), ("unit", "row", "column"), "m degrees")
            for side in SIDES
            for mode in occlusion_modes(model)
        ]

    def attributes(self, model: LoadedModel, differences: str = "float32") -> dict[str, str]:
        trunk = fold_batch_norm(model.network.trunk).cpu()
        reason = non_local_reason(trunk)
        if reason is not None:
            return {"method": f"in full: {reason}"}
        if differences != "float32":
            return {"method": f"{_BY_LOCALITY}, differences in {differences}"}
        cost = local_cost(LocalGraph(trunk), model.contract.shape, self._patches(model))
        if cost < 1:
            return {"method": _BY_LOCALITY}
        return {"method": "in full: locality does not save time"}

    def uses_base(self, attributes: Mapping[str, str]) -> bool:
        return attributes["method"].startswith(_BY_LOCALITY)

    def is_local(self, model: LoadedModel) -> bool:
        """Whether the trunk can be recomputed locally."""
        return non_local_reason(fold_batch_norm(model.network.trunk)) is None

    def _patches(self, model: LoadedModel) -> list[PixelRegion]:
        return cut_patches(*model.contract.size, self.params["patches"])

    def compute(self, pair: PairBatch) -> HeatArrays:
        height, width = pair.model.contract.size
        at_once = max(1, _pixels_at_once(pair.backend) // (height * width))
        method = self._method_of(pair.backend)
        heat: HeatArrays = {}
        for side in SIDES:
            parts = [
                self._chunk(pair, side, method, slice(start, start + at_once))
                for start in range(0, len(pair.sim.x), at_once)
            ]
            changes = np.concatenate(parts)
            for number, mode in enumerate(occlusion_modes(pair.model)):
                heat[side, mode] = changes[:, :, :, :, number]
        return heat

    def _method_of(self, backend: Backend) -> Recompute:
        """The function that recomputes the poses of changed inputs."""
        return _chosen_method(self, backend)

    def _chunk(
        self, pair: PairBatch, side: Side, recompute: Recompute, rows: slice
    ) -> NDArray[np.float32]:
        """Changes (B, 2, patches, patches, modes) of the errors of one side's inputs."""
        count, changed, other = self.params["patches"], pair.side(side), pair.side(_OTHER[side])
        base = None if changed.base is None else changed.base.images(rows)
        patches = self._patches(pair.model)
        with torch.inference_mode():
            before, after = recompute(
                pair.backend, changed.x[rows], other.x[rows], patches, base=base
            )
        truth = changed.truth[rows]
        change = (
            _pose_errors(after, truth[:, None, None]) - _pose_errors(before, truth)[:, None, None]
        )
        if side == "real":
            change = -change
        grid = change.reshape(len(truth), count, count, -1, 2)
        return np.moveaxis(grid, -1, 1).astype(np.float32)

    def ray(self, mode: str | None) -> Ray:
        return "depth" if mode == "depth" else "rgb"


def occlusion_modes(model: LoadedModel) -> tuple[Mode, ...]:
    """What is replaced in the input of a model, which may lack colours or depth."""
    return _MODES[model.contract.channels]


def _chosen_method(kind: Occlusion, backend: Backend) -> Recompute:
    """As `Occlusion.attributes` names it for the backend's model and precision of differences."""
    key = backend.differences
    if backend not in _METHODS or _METHODS[backend][0] != key:
        method = kind.attributes(backend.model, key)["method"]
        recompute: Recompute = _recompute_fully
        if method.startswith(_BY_LOCALITY) and backend.trunk is not None:
            graph = DifferenceGraph(backend.base_pass or LocalGraph(backend.trunk), key)
            recompute = partial(_recompute_differences, graph=graph)
        _METHODS[backend] = key, recompute
    return _METHODS[backend][1]


def _pixels_at_once(backend: Backend) -> int:
    """Pixels of the inputs that are changed at once: what caches or the GPU's memory take."""
    return _PIXELS_AT_ONCE if backend.device.type == "cpu" else _PIXELS_AT_ONCE_ON_GPU


def _pose_errors(poses: NDArray[np.float64], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Position error in metres and heading error in degrees, in the last axis."""
    off = np.hypot(poses[..., 0] - truth[..., 0], poses[..., 1] - truth[..., 1])
    turn = np.degrees(angles.distance(poses[..., 2], truth[..., 2]))
    return np.stack([off, turn], axis=-1)


def _patch_content(
    model: LoadedModel, inputs: Tensor, others: Tensor, region: PixelRegion
) -> Tensor:
    """Content of a patch in each mode: (N, M, C, h, w)."""
    rows, cols = slice(region.r0, region.r1), slice(region.c0, region.c1)
    patch, replacement = inputs[..., rows, cols], others[..., rows, cols]
    modes = occlusion_modes(model)
    content = patch[:, None].repeat(1, len(modes), 1, 1, 1)
    for number, mode in enumerate(modes):
        channels = list(model.contract.rows(mode))
        content[:, number, channels] = replacement[:, channels]
    return content


def _patch_change(model: LoadedModel, change: Tensor, region: PixelRegion) -> Tensor:
    """Change of a patch in each mode, (N, M, h, w, C), from that of the images, (N, H, W, C)."""
    part = change[:, region.r0 : region.r1, region.c0 : region.c1]
    modes = occlusion_modes(model)
    content = part.new_zeros(len(part), len(modes), *part.shape[1:])
    for number, mode in enumerate(modes):
        first, *others = model.contract.rows(mode)
        channels = slice(first, first + 1 + len(others))
        content[:, number, ..., channels] = part[..., channels]
    return content


def _poses(backend: Backend, features: Tensor) -> NDArray[np.float64]:
    network = backend.model.network
    return backend.pose(network.head(network.embed(features)))


def _recompute_differences(
    backend: Backend,
    inputs: Tensor,
    others: Tensor,
    patches: list[PixelRegion],
    graph: DifferenceGraph,
    base: BaseOutputs | None = None,
) -> Poses:
    """Poses (N, 3) of the unchanged inputs and (N, P, M, 3) of the changed ones.

    Only what the patches change is computed, by differences in the precision of the graph.
    """
    if base is None:
        base = graph.compute_base(inputs.contiguous(memory_format=torch.channels_last))
    output = graph.graph.output
    features, network = base.outputs[output], backend.model.network
    change = (others - inputs).permute(0, 2, 3, 1)
    embed = _embedding_of_changes(network, features)
    modes = len(occlusion_modes(backend.model))
    poses = np.empty((len(inputs), len(patches), modes, 3))
    regions = [graph.graph.affected_regions(patch, base) for patch in patches]
    for numbers in _batches(graph.graph, regions):
        content = [_patch_change(backend.model, change, patches[number]) for number in numbers]
        stacked = torch.stack(content, dim=1).permute(0, 1, 2, 5, 3, 4)
        changes = graph.recompute(base, stacked, [regions[number] for number in numbers])
        raw = network.head(embed(changes, [regions[number][output] for number in numbers]))
        poses[:, numbers] = backend.pose(raw).reshape(len(inputs), len(numbers), modes, 3)
    return _poses(backend, features), poses


Embed = Callable[[Tensor, list[PixelRegion]], Tensor]


def _embedding_of_changes(network: PoseNetwork, features: Tensor) -> Embed:
    """Function (N, P, M, C, h, w), P regions -> (N P M, D): embeddings of the changed features.

    It takes changes of regions of `features` (N, C, fh, fw). Where the embedding is an average
    pool, only the change is pooled.
    """
    pool = network.average_pool

    def embed(changes: Tensor, regions: list[PixelRegion]) -> Tensor:
        parts = []
        for position, region in enumerate(regions):
            full = features[:, None].repeat(1, changes.shape[2], 1, 1, 1)
            full[..., region.r0 : region.r1, region.c0 : region.c1] += changes[:, position]
            parts.append(network.embed(full.flatten(0, 1)).unflatten(0, full.shape[:2]))
        return torch.stack(parts, dim=1).flatten(0, 2)

    if pool is None:
        return embed
    unchanged = network.embed(features)
    sides = pool.output_size if isinstance(pool.output_size, tuple) else (pool.output_size,) * 2
    lengths = zip(features.shape[-2:], sides, strict=True)
    rows, columns = (_pool_weights(n, n if side is None else side, features) for n, side in lengths)

    def pooled(changes: Tensor, regions: list[PixelRegion]) -> Tensor:
        weights = torch.stack([
            torch.kron(rows[:, r.r0 : r.r1].contiguous(), columns[:, r.c0 : r.c1].contiguous())
            for r in regions
        ])  # fmt: skip
        last = changes.permute(0, 1, 2, 4, 5, 3).flatten(3, 4)
        means = weights[None, :, None] @ last
        embeddings = unchanged[:, None, None] + means.transpose(-1, -2).flatten(3)
        return embeddings.flatten(0, 2)

    return pooled


def _pool_weights(length: int, outputs: int, like: Tensor) -> Tensor:
    """Weights (outputs, length) of an adaptive average pool along one axis."""
    return functional.adaptive_avg_pool1d(
        torch.eye(length, dtype=like.dtype, device=like.device)[None], outputs
    )[0].T


def _batches(graph: LocalGraph, regions: list[dict[str, PixelRegion]]) -> list[list[int]]:
    """Numbers of the patches that can be computed together."""
    groups: dict[Any, list[int]] = {}
    for number, affected in enumerate(regions):
        groups.setdefault(graph.batch_signature(affected), []).append(number)
    return list(groups.values())


def _recompute_fully(
    backend: Backend,
    inputs: Tensor,
    others: Tensor,
    patches: list[PixelRegion],
    base: BaseOutputs | None = None,
) -> Poses:
    """Like `_recompute_differences`, by running the whole network on every changed input."""
    modes = len(occlusion_modes(backend.model))
    poses = np.empty((len(inputs), len(patches), modes, 3))
    for number, region in enumerate(patches):
        changed = inputs[:, None].repeat(1, modes, 1, 1, 1)
        changed[..., region.r0 : region.r1, region.c0 : region.c1] = _patch_content(
            backend.model, inputs, others, region
        )
        batches = changed.flatten(0, 1).split(_BATCH)
        changed_poses = [_poses(backend, _features(backend, batch)) for batch in batches]
        poses[:, number] = np.concatenate(changed_poses).reshape(len(inputs), modes, 3)
    return _poses(backend, _features(backend, inputs)), poses


def _features(backend: Backend, x: Tensor) -> Tensor:
    """Trunk features in float32 torch, whatever the precision of the backend."""
    assert backend.trunk is not None
    features: Tensor = backend.trunk(x.contiguous(memory_format=torch.channels_last))
    return features
