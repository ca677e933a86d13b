"""Draw the points of a plot in character cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rtui.canvas import UNICODE, Canvas, RenderOptions, legible, mix, turbo
from s2rtui.canvas.raster import braille_bits, cells_with_dots
from s2rtui.drawing.heat_colours import ramp_glyphs
from s2rtui.drawing.legend import LegendPart, text_part
from s2rtui.drawing.plot import Plot, Points
from s2rtui.drawing.points import PointCells, canvas_grid, point_cells
from s2rtui.drawing.trained_marks import (
    TrainedForms,
    digit_forms,
    mark_trained,
    number_forms,
    number_glyphs,
    trained_legend,
)

SINGLE = 8
"""Up to this number of instances a cell shows each as a braille dot, above it a shade."""
SHADE_STEPS = (SINGLE + 1, 65, 513, 4097)
"""Numbers of instances from which a cell has each shade."""
_GROUND = 0.3
"""Opacity of the colour behind shades, and behind the dots of selected instances."""


def _dots_of_counts() -> NDArray[np.uint32]:
    """(256, SINGLE + 1): the bits of a cell with as many dots as instances.

    Instances in one place of the cell take free places from the first on.
    """
    table = np.zeros((256, SINGLE + 1), dtype=np.uint32)
    for bits in range(256):
        for count in range(SINGLE + 1):
            filled = bits
            while filled.bit_count() < count:
                filled |= ~filled & (filled + 1)
            table[bits, count] = filled
    return table


_DOTS = _dots_of_counts()


def draw_points(canvas: Canvas, plot: Plot, points: Points) -> None:
    """Braille dots of few instances per cell, a shade of many, signs where there are no colours.

    Cells with selected instances show these alone, in the colour of their mean level.
    """
    cells = point_cells(points, canvas_grid(canvas, plot))
    _draw_cells(canvas, points, cells)
    if points.trained is not None:
        if _names(points, canvas.options) is None:
            count = cells.count[cells.trained]
            canvas.char[cells.trained] = number_glyphs(count, canvas.glyphs.selected)
        mark_trained(canvas, cells.trained, _forms(points, canvas.options))


def _draw_cells(canvas: Canvas, points: Points, cells: PointCells) -> None:
    theme, options = canvas.theme, canvas.options
    highlighted, held = cells.level >= 0, cells.count > 0
    canvas.fg[held] = theme.unselected
    canvas.fg[highlighted] = _inks(points, options)[cells.level[highlighted]]
    if options.ascii:
        grey = cells_with_dots(cells.grey)
        canvas.char[grey] = canvas.glyphs.unselected
    else:
        single = held & (cells.count <= SINGLE)
        bits = _DOTS[braille_bits(cells.dots)[single], cells.count[single]]
        canvas.char[single] = (0x2800 + bits).astype(np.uint32).view("<U1")
        steps = np.digitize(cells.count, SHADE_STEPS)
        many = held & ~single
        canvas.char[many] = np.array(list(UNICODE.shades))[steps[many]]
        tinted = (highlighted | many) if options.supports_images else many & False
        canvas.bg[tinted] = mix(theme.background, canvas.fg[tinted], _GROUND)
    names = _names(points, options)
    if names is not None:
        canvas.char[highlighted] = names[cells.level[highlighted]]
        canvas.bold[highlighted & (cells.count > 1)] = True


def _inks(points: Points, options: RenderOptions) -> NDArray[np.uint8]:
    """The colour of each level, (depth + 1, 3)."""
    theme, inks = options.theme, np.empty((points.depth + 1, 3), dtype=np.uint8)
    inks[0] = theme.text
    if points.inks:
        inks[1:] = [getattr(theme, ink) for ink in points.inks]
    else:
        inks[1:] = legible(turbo((np.arange(points.depth) + 0.5) / points.depth), theme)
    return inks


def _names(points: Points, options: RenderOptions) -> NDArray[np.str_] | None:
    """The glyph of each level where colours do not tell them apart."""
    digits = ramp_glyphs("values", options)
    if digits is None:
        return None
    if points.inks:
        return np.array(["?", *(getattr(options.glyphs, ink) for ink in points.inks)])
    return np.array(["?", *(digits[place * 10 // points.depth] for place in range(points.depth))])


def _forms(points: Points, options: RenderOptions) -> TrainedForms:
    """The forms of trained instances: of digits that stand for values, or of numbers."""
    if ramp_glyphs("values", options) is None:
        return number_forms(options, options.glyphs.selected)
    if points.inks:
        signs = "".join(getattr(options.glyphs, ink) for ink in points.inks)
        return number_forms(options, signs)
    return digit_forms(options)


def points_legend(points: Points, options: RenderOptions) -> list[LegendPart]:
    """What a cell of points shows."""
    theme, ramp = options.theme, ramp_glyphs("values", options)
    parts = []
    if not points.inks:
        mean = "digit" if ramp else "colour"
        parts.append(text_part(((f"{mean}: mean of the selected", theme.muted),)))
    grey = options.glyphs.unselected if options.ascii else "⠿"
    parts.append(text_part(((f"{grey} ", theme.unselected), ("none selected", theme.muted))))
    if points.trained is not None:
        parts.append(trained_legend(options, _forms(points, options)))
    if ramp is not None:
        parts.append(text_part((("bold: several", theme.muted),)))
    if not options.ascii:
        most = int(np.count_nonzero(points.valid))
        steps = zip(options.glyphs.shades[1:], SHADE_STEPS, strict=True)
        shades = [f"{shade} {least}+" for shade, least in steps if least <= most]
        text = "  ".join([f"⠿ 1 to {SINGLE}", *shades])
        parts.append(text_part(((f"{text} per cell", theme.muted),)))
    return parts
