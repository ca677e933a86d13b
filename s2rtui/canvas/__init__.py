"""Drawing in character cells: the canvas, colours, glyphs, rasters and brush panels."""

from s2rtui.canvas.canvas import Canvas, InlineImage, Size
from s2rtui.canvas.colour import DARK, LIGHT, THEMES, ColourMode, Rgb, Theme
from s2rtui.canvas.render_options import ASCII, UNICODE, Glyphs, RenderOptions, heading_arrow

__all__ = [
    "ASCII",
    "DARK",
    "LIGHT",
    "THEMES",
    "UNICODE",
    "Canvas",
    "ColourMode",
    "Glyphs",
    "InlineImage",
    "RenderOptions",
    "Rgb",
    "Size",
    "Theme",
    "heading_arrow",
]
