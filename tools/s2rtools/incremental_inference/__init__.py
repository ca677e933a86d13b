"""Incremental inference: recompute a network only where a changed input patch has an effect."""

from s2rtools.incremental_inference.base_pass import BasePass
from s2rtools.incremental_inference.cost_model import local_cost
from s2rtools.incremental_inference.differences import DifferenceGraph
from s2rtools.incremental_inference.graph import BaseOutputs, LocalGraph, non_local_reason
from s2rtools.incremental_inference.regions import PixelRegion, SlidingWindow, cut_patches

__all__ = [
    "BaseOutputs",
    "BasePass",
    "DifferenceGraph",
    "LocalGraph",
    "PixelRegion",
    "SlidingWindow",
    "cut_patches",
    "local_cost",
    "non_local_reason",
]
