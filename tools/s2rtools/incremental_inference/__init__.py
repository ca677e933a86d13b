"""Recomputing a network only where a changed patch of its input can reach."""

from s2rtools.incremental_inference.graph import LocalGraph, analyse
from s2rtools.incremental_inference.patches import Patch, cut_patches
from s2rtools.incremental_inference.regions import PixelRegion, Window

__all__ = ["LocalGraph", "Patch", "PixelRegion", "Window", "analyse", "cut_patches"]
