"""Dials: plots whose x are degrees of a full turn, as radial bars in character cells."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry import angles
from s2rtui.canvas import BrushShape, Canvas, PlotArea, Point, RenderOptions, Rgb, heading_arrow
from s2rtui.canvas.marks import mark_arc, mark_on_panel
from s2rtui.canvas.raster import cells_with_dots, draw_braille, segment_dots
from s2rtui.drawing.plot import Bars, Dots, Plot
from s2rtui.drawing.plot_cells import style_of

Floats = NDArray[np.float64]
Grid = NDArray[np.bool_]
RING = 0.32
"""Radius of the ring, at which y begins, as a share of the rim's."""
_SMALLEST, _SMALLEST_ASCII = 6.0, 12.0
"""Smallest radius of a dial in columns."""
_QUADRANTS = np.array(list(" ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"))
_QUARTER = np.array([[1, 2], [4, 8]])


@dataclass(frozen=True, slots=True)
class Dial:
    """A disc in cells: centre, radii of ring and rim in columns (a row counts as two columns).

    Degrees start at the right and go downwards if `clockwise`. margin: columns and rows beside it,
    in which its ticks are labelled; zero where there is no room for labels.
    """

    x: float
    y: float
    ring: float
    rim: float
    clockwise: bool
    margin: tuple[int, int]

    @property
    def box(self) -> tuple[int, int, int, int]:
        """The cells (x, y, width, height) of the disc, between the labels of its ticks."""
        left, top = math.floor(self.x - self.rim), math.ceil(self.y - self.rim / 2)
        return left, top, math.ceil(self.x + self.rim) - left, round(2 * self.y) - 2 * top

    def to_data(self, column: float, row: float) -> Point:
        """Convert a place in cells to degrees in [-180, 180) and radius (ring: 0, rim: 1)."""
        across, down = column - self.x, 2 * (row - self.y)
        turn = float(np.degrees(np.arctan2(down if self.clockwise else -down, across)))
        distance = float(np.hypot(across, down))
        return (turn if turn < 180 else -180.0), (distance - self.ring) / (self.rim - self.ring)

    def to_cells(self, degrees: float, radius: float) -> Point:
        """Convert degrees and radius to a place in cells; the inverse of `to_data`."""
        distance = self.ring + radius * (self.rim - self.ring)
        turn = np.radians(degrees)
        down = distance * np.sin(turn) * (1 if self.clockwise else -1)
        return float(self.x + distance * np.cos(turn)), float(self.y + down / 2)


def dial_of(plot: Plot, width: int, height: int) -> Dial:
    """The largest disc of a plot in `width` x `height` cells."""
    has_labels = width >= 24 and height >= 11
    margin = (3 if width < 32 else 4, 1) if has_labels else (0, 0)
    rim = max(1.0, min(width / 2 - margin[0], float(height - 2 * margin[1])))
    return Dial(width / 2, height / 2, RING * rim, rim, plot.turns == "clockwise", margin)


def dial_rows(plot: Plot, width: int, height: int, options: RenderOptions) -> int | None:
    """The rows that the disc takes of `width` x `height` cells; None where it would be too small.

    In as many rows it is as large.
    """
    dial = dial_of(plot, width, height)
    if dial.rim < (_SMALLEST_ASCII if options.ascii else _SMALLEST):
        return None
    return min(height, math.ceil(dial.rim + 2 * dial.margin[1]))


def dial_panel(plot: Plot, x: int, y: int, width: int, height: int) -> PlotArea:
    """The panel of a dial in a rectangle of cells: degrees in [-180, 180), and y."""
    dial = dial_of(plot, width, height)

    def to_data(column: float, row: float) -> Point:
        degrees, radius = dial.to_data(column - x, row - y)
        return degrees, float(plot.y.value(radius))

    def to_cells(degrees: float, at: float) -> Point:
        column, row = dial.to_cells(degrees, float(plot.y.fraction(at)))
        return column + x, row + y

    return PlotArea(plot.name, plot.shape, x, y, width, height, to_data, to_cells)


def draw_dial(canvas: Canvas, plot: Plot, brush: BrushShape | None) -> None:
    """Draw the marks of a plot on a disc, an arc that is being brushed, and the labels of x."""
    dial = dial_of(plot, canvas.width, canvas.height)
    mark = mark_on_panel(brush, plot.name)
    if mark is not None:
        _draw_arc(canvas, dial, mark)
    for bars in (each for each in plot.marks if isinstance(each, Bars)):
        _draw_bars(canvas, dial, plot, bars)
    if mark is not None:
        middle, half = mark_arc(mark)
        for degrees in (middle - half, middle + half):
            _put(canvas, dial, (degrees, 1.0), "+", canvas.theme.truth)
    for dots in (each for each in plot.marks if isinstance(each, Dots)):
        _draw_directions(canvas, dial, plot, dots)
    if dial.margin[1]:
        _draw_labels(canvas, dial, plot)


def bar_dots(
    dial: Dial, width: int, height: int, edges: Floats, lengths: Floats, fine: int = 4
) -> Grid:
    """Dots (fine height, 2 width) of bars between `edges` (n + 1,) in degrees; lengths: 0 .. 1.

    Bars that are thinner than a dot have the dots along their middle.
    """
    degrees, distance = _polar(dial, width, height, fine)
    share = (distance - dial.ring) / (dial.rim - dial.ring)
    places = np.searchsorted(edges, (degrees - edges[0]) % 360 + edges[0], side="right") - 1
    inside = (places >= 0) & (places < lengths.size)
    lengths = np.clip(lengths, 0.0, 1.0)
    dots: Grid = inside & (share > 0) & (share <= lengths[np.where(inside, places, 0)])
    along = np.arange(dial.ring + 0.5, dial.rim, 0.25)
    along = along if along.size else np.array([dial.rim])
    turn = np.radians((edges[:-1] + edges[1:]) / 2)[:, None]
    down = np.sin(turn) * along * (1 if dial.clockwise else -1)
    columns = np.floor(2 * (dial.x + np.cos(turn) * along)).astype(np.intp)
    rows = np.floor(fine * (dial.y + down / 2)).astype(np.intp)
    radii = (along - dial.ring) / (dial.rim - dial.ring)
    reached = (lengths[:, None] > 0) & (radii <= np.maximum(lengths, radii[0])[:, None])
    reached &= (columns >= 0) & (columns < 2 * width) & (rows >= 0) & (rows < fine * height)
    dots[rows[reached], columns[reached]] = True
    return dots


@lru_cache(32)
def _polar(dial: Dial, width: int, height: int, fine: int, wide: int = 2) -> tuple[Floats, Floats]:
    """Degrees and distance from the centre (columns) of the dots of `width` x `height` cells.

    fine, wide: dots of a cell, above and beside each other.
    """
    across = (np.arange(wide * width) + 0.5) / wide - dial.x
    down = ((np.arange(fine * height) + 0.5) / fine - dial.y) * 2
    turn = np.arctan2((down if dial.clockwise else -down)[:, None], across[None, :])
    return np.degrees(turn), np.hypot(down[:, None], across[None, :])


def _draw_bars(canvas: Canvas, dial: Dial, plot: Plot, bars: Bars) -> None:
    """The ring, grey bars, and before them the others: in braille dots and in quarter blocks."""
    size, theme = (canvas.width, canvas.height), canvas.theme
    colour: Rgb = getattr(theme, bars.ink)
    part = bar_dots(dial, *size, bars.edges, plot.y.fraction(bars.part), fine=2)
    whole = bar_dots(dial, *size, bars.edges, plot.y.fraction(bars.whole))
    ring: Grid = np.abs(2 * _polar(dial, *size, 4)[1] - 2 * dial.ring) < 0.5
    if canvas.options.ascii:
        for dots, fine, glyph, ink in (
            (ring, 4, "o", theme.muted), (whole, 4, ".", theme.unselected), (part, 2, "#", colour)
        ):  # fmt: skip
            cells = cells_with_dots(dots, fine)
            canvas.char[cells] = glyph
            canvas.fg[cells] = ink
        return
    draw_braille(canvas, whole | ring, theme.unselected)
    parts = part.reshape(canvas.height, 2, canvas.width, 2)
    quarters = (parts * _QUARTER[None, :, None, :]).sum(axis=(1, 3))
    held = quarters > 0
    canvas.char[held] = _QUADRANTS[quarters[held]]
    canvas.fg[held] = colour


def _draw_directions(canvas: Canvas, dial: Dial, plot: Plot, dots: Dots) -> None:
    """Lines from the centre to the ring, in ASCII arrows at the centre, and the signs of dots."""
    glyph, colour = style_of(canvas, dots)
    for degrees, radius in zip(dots.x.tolist(), plot.y.fraction(dots.y).tolist(), strict=True):
        if canvas.options.ascii:
            arrow = heading_arrow(np.radians(degrees), dial.clockwise, canvas.glyphs)[0]
            canvas.put(int(dial.x), int(dial.y), arrow, colour, bold=True)
        else:
            line = (dial.x, dial.y), dial.to_cells(degrees, 0.0)
            draw_braille(canvas, segment_dots([line], canvas.width, canvas.height), colour)
        _put(canvas, dial, (degrees, radius), glyph, colour)


def _draw_arc(canvas: Canvas, dial: Dial, mark: BrushShape) -> None:
    """The ground of the sector of a brush mark."""
    middle, half = mark_arc(mark)
    degrees, _ = _polar(dial, canvas.width, canvas.height, 1, 1)
    canvas.bg[np.abs(angles.wrap_degrees(degrees - middle)) <= half] = canvas.theme.highlight


def _put(canvas: Canvas, dial: Dial, point: Point, glyph: str, colour: Rgb) -> None:
    column, row = dial.to_cells(*point)
    across = min(max(int(np.floor(column)), 0), canvas.width - 1)
    down = min(max(int(np.floor(row)), 0), canvas.height - 1)
    canvas.put(across, down, glyph, colour, bold=True)


def _draw_labels(canvas: Canvas, dial: Dial, plot: Plot) -> None:
    """The labels of x around the rim; of ticks in the same direction the last one."""
    ticks = {round(degrees % 360): text for degrees, text in plot.x.ticks(4)}
    for degrees, text in ticks.items():
        column, row = np.round(dial.to_cells(degrees, 1.0), 6)
        start, at = int(column) - len(text) // 2, int(np.floor(row))
        if degrees == 0:
            start = int(np.ceil(column)) + 1
        elif degrees == 180:
            start = max(0, int(column) - 1 - len(text))
        else:
            at = int(np.ceil(row)) - (row <= dial.y)
        canvas.text(start, at, text, canvas.theme.muted)
