"""Heatmap `feature_distance`: difference of both sides' features at the last convolution."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from s2rtools.heatmaps.heatmap_method import (
    HeatArrays,
    HeatmapKind,
    OutputSpec,
    PairBatch,
    feature_size,
)
from s2rtools.models.pose_network import LoadedModel


class FeatureDistance(HeatmapKind):
    """Per cell of the last convolution, (1 - cosine) * mean |A_sim - A_real| over channels.

    At least 0; cells without any activation on a side count as orthogonal. Source:
    Sim2RealViz, section 4.4: the product of cosine distance and L1.
    """

    name = "feature_distance"
    uses_truth = False
    uses_features = True

    def outputs(self, model: LoadedModel) -> list[OutputSpec]:
        return [OutputSpec(None, None, feature_size(model), ("row", "column"), "activation")]

    def compute(self, pair: PairBatch) -> HeatArrays:
        sim, real = pair.features("sim"), pair.features("real")
        return {(None, None): feature_difference(sim, real).cpu().numpy()}


def feature_difference(sim: Tensor, real: Tensor) -> Tensor:
    """(1 - cosine) * mean |sim - real| over the channels of features (B, F, h, w), (B, h, w).

    Norms are at least 1e-8. The fastest with channels last in memory.
    """
    norms = (torch.linalg.vector_norm(x, dim=1).clamp_min(1e-8) for x in (sim, real))
    cosine = torch.einsum("bfhw,bfhw->bhw", sim, real) / math.prod(norms)
    return (1 - cosine.clamp(-1, 1)) * (sim - real).abs().mean(dim=1)
