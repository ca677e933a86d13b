"""Heatmap `feature_distance`: difference of both sides' features at the last convolution."""

from __future__ import annotations

from torch.nn import functional

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
        cosine = functional.cosine_similarity(sim, real, dim=1, eps=1e-8).clamp(-1, 1)
        distance = (1 - cosine) * (sim - real).abs().mean(dim=1)
        return {(None, None): distance.cpu().numpy()}
