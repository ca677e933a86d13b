"""Interactive inference: predictions and heatmaps of one instance under any adjustments."""

from s2rtools.interactive.live_model import LiveModel, LiveResult, LiveSide

__all__ = ["LiveModel", "LiveResult", "LiveSide"]
