"""Heatmaps: maps over an image that show where the gap or the pose error arises.

Registry: `HEATMAP_KINDS` maps a heatmap kind's name to a `HeatmapKind`. To add a heatmap, write one
module with a subclass of `HeatmapKind` and add one line to `_OWN`. A package adds one by an
entry point of the group `s2r.heatmaps`, an instance whose facts are in the class.
"""

from __future__ import annotations

from s2rstore.plugins import Registry, instance_of
from s2rtools.heatmaps.activation import Activation
from s2rtools.heatmaps.feature_distance import FeatureDistance
from s2rtools.heatmaps.harm import Harm, HarmFine
from s2rtools.heatmaps.harmonized_difference import HarmonisedDifference, HarmonisedDistance
from s2rtools.heatmaps.heatmap_method import (
    HeatmapKind,
    ImageHeatmapKind,
    OutputSpec,
    PairBatch,
    SideBatch,
)
from s2rtools.heatmaps.occlusion import Occlusion
from s2rtools.heatmaps.pixel_difference import PixelDifference

__all__ = [
    "HEATMAP_KINDS", "IMAGE_KINDS", "HeatmapKind", "OutputSpec", "PairBatch", "SideBatch",
]  # fmt: skip

_OWN: tuple[HeatmapKind, ...] = (
    Activation(),
    FeatureDistance(),
    PixelDifference(),
    HarmonisedDistance(),
    HarmonisedDifference(),
    Occlusion(),
    Harm(),
    HarmFine(),
)
HEATMAP_KINDS = Registry[HeatmapKind](
    "heatmap", {kind.name: kind for kind in _OWN}, instance_of(HeatmapKind)
)

IMAGE_KINDS: dict[str, ImageHeatmapKind] = {
    name: kind for name, kind in HEATMAP_KINDS.items() if isinstance(kind, ImageHeatmapKind)
}
"""The kinds that need no network."""
