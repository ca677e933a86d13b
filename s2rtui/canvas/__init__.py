"""Drawing in character cells: the canvas, colours, glyphs, rasters and brush panels."""

from s2rtui.canvas.canvas import Canvas, InlineImage, Size
from s2rtui.canvas.colour import (
    DARK,
    LIGHT,
    THEMES,
    ColourMode,
    Pixels,
    Rgb,
    Theme,
    diverging,
    legible,
    luma,
    mix,
    turbo,
)
from s2rtui.canvas.marks import BrushShape, PlotArea, Point
from s2rtui.canvas.render_options import (
    ASCII,
    DEFAULT_OPTIONS,
    DIGITS,
    UNICODE,
    Glyphs,
    RenderOptions,
    heading_arrow,
)

__all__ = [
    "ASCII",
    "DARK",
    "DEFAULT_OPTIONS",
    "DIGITS",
    "LIGHT",
    "THEMES",
    "UNICODE",
    "BrushShape",
    "Canvas",
    "ColourMode",
    "Glyphs",
    "InlineImage",
    "Pixels",
    "PlotArea",
    "Point",
    "RenderOptions",
    "Rgb",
    "Size",
    "Theme",
    "diverging",
    "heading_arrow",
    "legible",
    "luma",
    "mix",
    "turbo",
]  # fmt: skip
