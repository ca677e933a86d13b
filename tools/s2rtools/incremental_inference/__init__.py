"""Recomputing a network only where a changed patch of its input can reach."""

from s2rtools.incremental_inference.graph import LocalGraph, non_local_reason
from s2rtools.incremental_inference.patches import Patch, cut_patches
from s2rtools.incremental_inference.regions import PixelRegion, SlidingWindow

__all__ = ["LocalGraph", "Patch", "PixelRegion", "SlidingWindow", "cut_patches", "non_local_reason"]
