"""Heatmaps: `HEATMAP_KINDS` lists the methods. Adding one is a file and a line here."""

from __future__ import annotations

from s2rtools.heatmaps.activation import Activation
from s2rtools.heatmaps.feature_distance import FeatureDistance
from s2rtools.heatmaps.harmonized_difference import HarmonisedDifference, HarmonisedDistance
from s2rtools.heatmaps.heatmap_method import HeatmapKind, OutputSpec, PairBatch, SideBatch
from s2rtools.heatmaps.occlusion import Occlusion
from s2rtools.heatmaps.pixel_difference import PixelDifference

__all__ = ["HEATMAP_KINDS", "HeatmapKind", "OutputSpec", "PairBatch", "SideBatch"]

HEATMAP_KINDS: dict[str, HeatmapKind] = {
    kind.name: kind
    for kind in (
        Activation(),
        FeatureDistance(),
        PixelDifference(),
        HarmonisedDistance(),
        HarmonisedDifference(),
        Occlusion(),
    )
}
