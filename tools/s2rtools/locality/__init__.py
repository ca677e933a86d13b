"""Recomputing a network only where a changed patch of its input can reach."""

from s2rtools.locality.graph import LocalGraph, analyse
from s2rtools.locality.patches import Patch, cut_patches
from s2rtools.locality.regions import Region, Window

__all__ = ["LocalGraph", "Patch", "Region", "Window", "analyse", "cut_patches"]
