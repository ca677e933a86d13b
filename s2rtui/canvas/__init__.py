"""Drawing in cells: a canvas of arrays, rasters in it, and its way to the terminal."""

from s2rtui.canvas.colour import DARK, LIGHT, THEMES, ColourMode, Rgb, Theme
from s2rtui.canvas.grid import Canvas, Plate, Size
from s2rtui.canvas.look import ASCII, UNICODE, Glyphs, Look, heading_arrow
from s2rtui.canvas.strips import DeltaStrip, to_strips

__all__ = [
    "ASCII",
    "DARK",
    "LIGHT",
    "THEMES",
    "UNICODE",
    "Canvas",
    "ColourMode",
    "DeltaStrip",
    "Glyphs",
    "Look",
    "Plate",
    "Rgb",
    "Size",
    "Theme",
    "heading_arrow",
    "to_strips",
]
