"""Occlusion by incremental inference against 216 forward passes at the best batch size."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import torch

from bench.budget import BudgetRow, seconds
from bench.measured_stores import lively
from s2rtools.heatmaps import occlusion
from s2rtools.incremental_inference import DifferenceGraph, LocalGraph, cut_patches
from s2rtools.inference import Backend
from s2rtools.models.pose_network import LoadedModel


def figures(threads: int) -> Iterator[BudgetRow]:
    """Time one pair in three modes and both directions; posest and resposenet, float32."""
    torch.set_num_threads(threads)
    for architecture, budget in (("posest", 0.20), ("resposenet", None)):
        network = lively(architecture)
        model = LoadedModel(architecture, architecture, network, network.convention, "")
        backend = Backend(model, threads)
        x = torch.rand(2, *model.contract.shape) * 2 - 1
        other = x.flip(0).contiguous()
        patches = cut_patches(*model.contract.size)
        graph = DifferenceGraph(LocalGraph(backend.trunk), "float32")
        with torch.inference_mode():
            local = seconds(
                partial(occlusion._recompute_differences, backend, x, other, patches, graph), 3
            )
            forwards = [
                216 / batch * seconds(partial(_forward, backend, x[:1].repeat(batch, 1, 1, 1)), 3)
                for batch in (1, 2, 4, 8)
            ]
        full = min(forwards)
        yield BudgetRow(f"occlusion in full, {architecture}", full, "s")
        yield BudgetRow(f"occlusion by locality, {architecture}", local, "s")
        yield BudgetRow(
            f"occlusion by locality / in full, {architecture}", local / full, "ratio", budget
        )


def _forward(backend: Backend, x: torch.Tensor) -> torch.Tensor:
    network = backend.model.network
    return network.head(network.embed(backend.features(x)))
