"""Heatmap `occlusion`: change of the error if a patch is replaced by the other side's."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from s2rstore.geometry import angles
from s2rstore.records import SIDES
from s2rtools.heatmaps.heatmap_method import HeatArrays, HeatmapKind, OutputSpec, PairBatch, Ray
from s2rtools.incremental_inference import LocalGraph, PixelRegion, cut_patches, non_local_reason
from s2rtools.inference import Backend
from s2rtools.inference.batch_norm_folding import fold_batch_norm
from s2rtools.models.pose_network import LoadedModel

MODES = ("rgb", "depth", "rgbd")
_CHANNELS = {"rgb": (0, 1, 2), "depth": (3,), "rgbd": (0, 1, 2, 3)}
_BATCH = 8
_PIXELS_AT_ONCE = 8 * 128 * 128


class Occlusion(HeatmapKind):
    """Replace each of 6 x 6 patches of one side's input by the other side's patch.

    Plane 0 in metres, plane 1 in degrees of heading. Real input: error before - after; sim input:
    error after - before; so values > 0 mark where the gap arises. Always float32 torch. The network
    is recomputed locally if the trunk allows it, else fully: attribute `method`. Source: Zeiler and
    Fergus, "Visualizing and understanding convolutional networks", 2014, with the exchange of
    patches of Sim2RealViz, section 4.4.
    """

    name = "occlusion"
    params = {"patches": 6}  # noqa: RUF012
    cost = "many"

    def outputs(self, model: LoadedModel) -> list[OutputSpec]:
        count = self.params["patches"]
        reason = non_local_reason(fold_batch_norm(model.network.trunk))
        method = "by locality" if reason is None else f"in full: {reason}"
        return [
            OutputSpec(side, mode, (2, count, count), ("unit", "row", "column"), "m degrees",
                       attributes={"method": method})
            for side in SIDES
            for mode in MODES
        ]  # fmt: skip

    def compute(self, pair: PairBatch) -> HeatArrays:
        height, width = pair.model.network.input_size
        backend = _float32_backend(pair.backend)
        at_once = max(1, _PIXELS_AT_ONCE // (height * width))
        parts = [
            self._chunk(pair, backend, slice(start, start + at_once))
            for start in range(0, len(pair.sim.x), at_once)
        ]
        return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}

    def _chunk(self, pair: PairBatch, backend: Backend, rows: slice) -> HeatArrays:
        count = self.params["patches"]
        patches = cut_patches(*pair.model.network.input_size, count)
        inputs = torch.cat([pair.sim.x[rows], pair.real.x[rows]])
        others = torch.cat([pair.real.x[rows], pair.sim.x[rows]])
        graph = _graph_of(backend.trunk)
        with torch.inference_mode():
            if graph is None:
                before, after = _recompute_fully(backend, inputs, others, patches)
            else:
                before, after = _recompute_locally(backend, graph, inputs, others, patches)
        truth = np.concatenate([pair.sim.truth[rows], pair.real.truth[rows]])
        change = (
            _pose_errors(after, truth[:, None, None]) - _pose_errors(before, truth)[:, None, None]
        ).reshape(2, -1, count, count, len(MODES), 2)
        change[1] *= -1
        return {
            (side, mode): np.moveaxis(part[..., number, :], -1, 1).astype(np.float32)
            for side, part in zip(SIDES, change, strict=True)
            for number, mode in enumerate(MODES)
        }

    def ray(self, mode: str | None) -> Ray:
        return "depth" if mode == "depth" else "rgb"


@lru_cache(maxsize=2)
def _graph_of(trunk: torch.nn.Module) -> LocalGraph | None:
    return LocalGraph(trunk) if non_local_reason(trunk) is None else None


@lru_cache(maxsize=2)
def _float32_backend(backend: Backend) -> Backend:
    """Float32 backend of the model, because reduced precision would hide small effects."""
    return backend if type(backend) is Backend else Backend(backend.model)


def _pose_errors(poses: NDArray[np.float64], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Position error in metres and heading error in degrees, in the last axis."""
    off = np.hypot(poses[..., 0] - truth[..., 0], poses[..., 1] - truth[..., 1])
    turn = np.degrees(angles.distance(poses[..., 2], truth[..., 2]))
    return np.stack([off, turn], axis=-1)


def _patch_content(inputs: Tensor, others: Tensor, region: PixelRegion) -> Tensor:
    """Content of a patch in each mode: (N, M, 4, h, w)."""
    rows, cols = slice(region.r0, region.r1), slice(region.c0, region.c1)
    patch, replacement = inputs[..., rows, cols], others[..., rows, cols]
    content = patch[:, None].repeat(1, len(MODES), 1, 1, 1)
    for number, mode in enumerate(MODES):
        channels = list(_CHANNELS[mode])
        content[:, number, channels] = replacement[:, channels]
    return content


def _poses(backend: Backend, features: Tensor) -> NDArray[np.float64]:
    network = backend.model.network
    return backend.pose(network.head(network.embed(features)))


def _recompute_locally(
    backend: Backend, graph: LocalGraph, inputs: Tensor, others: Tensor, patches: list[PixelRegion]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses (N, 3) of the unchanged inputs and (N, P, M, 3) of the changed ones."""
    base = graph.compute_base(inputs.contiguous(memory_format=torch.channels_last))
    features = base.outputs[graph.output]
    poses = np.empty((len(inputs), len(patches), len(MODES), 3))
    regions = [graph.affected_regions(patch, base) for patch in patches]
    groups: dict[Any, list[int]] = {}
    for number in range(len(patches)):
        groups.setdefault(graph.batch_signature(regions[number]), []).append(number)
    for numbers in groups.values():
        content = [_patch_content(inputs, others, patches[number]) for number in numbers]
        changed = graph.recompute(
            base, torch.stack(content, dim=1), [regions[number] for number in numbers]
        )
        for position, number in enumerate(numbers):
            target = regions[number][graph.output]
            full = features[:, None].repeat(1, len(MODES), 1, 1, 1)
            full[..., target.r0 : target.r1, target.c0 : target.c1] = changed[:, position]
            changed_poses = _poses(backend, full.flatten(0, 1))
            poses[:, number] = changed_poses.reshape(len(inputs), len(MODES), 3)
    return _poses(backend, features), poses


def _recompute_fully(
    backend: Backend, inputs: Tensor, others: Tensor, patches: list[PixelRegion]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Like `_recompute_locally`, by running the whole network on every changed input."""
    poses = np.empty((len(inputs), len(patches), len(MODES), 3))
    for number, region in enumerate(patches):
        changed = inputs[:, None].repeat(1, len(MODES), 1, 1, 1)
        changed[..., region.r0 : region.r1, region.c0 : region.c1] = _patch_content(
            inputs, others, region
        )
        batches = changed.flatten(0, 1).split(_BATCH)
        changed_poses = [_poses(backend, backend.features(batch)) for batch in batches]
        poses[:, number] = np.concatenate(changed_poses).reshape(len(inputs), len(MODES), 3)
    return _poses(backend, backend.features(inputs)), poses
