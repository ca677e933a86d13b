"""Incremental inference: recompute a network only where a changed input patch has an effect."""

from s2rtools.incremental_inference.cost_model import local_cost
from s2rtools.incremental_inference.differences import DifferenceGraph
from s2rtools.incremental_inference.graph import LocalGraph, non_local_reason
from s2rtools.incremental_inference.regions import PixelRegion, SlidingWindow, cut_patches

__all__ = [
    "DifferenceGraph",
    "LocalGraph",
    "PixelRegion",
    "SlidingWindow",
    "cut_patches",
    "local_cost",
    "non_local_reason",
]
