"""Dials: radial bars of headings, as braille dots and in cells."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from s2rstore.geometry import angles
from s2rtui.canvas import BrushShape, Canvas, PlotArea, Point, Rgb, heading_arrow
from s2rtui.canvas.marks import mark_arc
from s2rtui.canvas.raster import cells_with_dots, draw_braille, line_dots
from s2rtui.drawing.bars import Bars

Dots = NDArray[np.bool_]
RING = 0.32
"""Radius of the ring as a share of the rim's."""


@dataclass(frozen=True, slots=True)
class Dial:
    """A disc in cells: centre, radii of ring and rim in columns (a row counts as two columns).

    Headings in degrees start at the right and go downwards if `y_down`.
    """

    x: float
    y: float
    ring: float
    rim: float
    y_down: bool

    def to_data(self, column: float, row: float) -> Point:
        """Convert a place in cells to degrees in [-180, 180) and radius (ring: 0, rim: 1)."""
        across, down = column - self.x, 2 * (row - self.y)
        turn = float(np.degrees(np.arctan2(down if self.y_down else -down, across)))
        distance = float(np.hypot(across, down))
        return (turn if turn < 180 else -180.0), (distance - self.ring) / (self.rim - self.ring)

    def to_cells(self, degrees: float, radius: float) -> Point:
        """Convert degrees and radius to a place in cells; the inverse of `to_data`."""
        distance = self.ring + radius * (self.rim - self.ring)
        turn = np.radians(degrees)
        down = distance * np.sin(turn) * (1 if self.y_down else -1)
        return float(self.x + distance * np.cos(turn)), float(self.y + down / 2)


def dial_of(x: float, y: float, width: int, height: int, y_down: bool, margin: Point) -> Dial:
    """The largest disc in a rectangle of cells, `margin` columns and rows from its edges."""
    rim = max(1.0, min(width / 2 - margin[0], height - 2 * margin[1]))
    return Dial(x + width / 2, y + height / 2, RING * rim, rim, y_down)


def ring_dots(dial: Dial, width: int, height: int) -> Dots:
    """Braille dots (4 height, 2 width) of the circle at which bars begin."""
    distance = 2 * _polar(dial, width, height, 4, 1)[1]
    return np.abs(distance - 2 * dial.ring) < 0.5


def bar_dots(dial: Dial, width: int, height: int, lengths: ArrayLike, fine: int = 4) -> Dots:
    """Dots (fine height, 2 width) of bars with `lengths` 0 .. 1, one per bin from -180 degrees."""
    lengths = np.clip(lengths, 0.0, 1.0)
    bin_of, share, rays, along = _bars(dial, width, height, fine, len(lengths))
    dots = (share > 0) & (share <= lengths[bin_of])
    reached = (lengths[:, None] > 0) & (along[None] <= np.maximum(lengths, along[0])[:, None])
    dots.flat[rays[reached & (rays >= 0)]] = True
    return np.asarray(dots)


@lru_cache(32)
def _polar(
    dial: Dial, width: int, height: int, fine: int, count: int
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Bin and distance from the centre (columns) of every dot of `width` x `height` cells."""
    across = (np.arange(2 * width) + 0.5) / 2 - dial.x
    down = ((np.arange(fine * height) + 0.5) / fine - dial.y) * 2
    turn = np.arctan2((down if dial.y_down else -down)[:, None], across[None, :])
    bin_of = np.floor((turn + np.pi) / (2 * np.pi) * count).astype(np.intp) % count
    return bin_of, np.hypot(down[:, None], across[None, :])


@lru_cache(32)
def _bars(
    dial: Dial, width: int, height: int, fine: int, count: int
) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.intp], NDArray[np.float64]]:
    """Bin and radius of each dot; and the dots (-1: outside) and radii along each bin's middle.

    The dots along the middle make bars visible that are thinner than a dot.
    """
    bin_of, distance = _polar(dial, width, height, fine, count)
    share = (distance - dial.ring) / (dial.rim - dial.ring)
    along = np.arange(dial.ring + 0.5, dial.rim, 0.25)
    along = along if along.size else np.array([dial.rim])
    turn = np.radians((np.arange(count) + 0.5) * 360 / count - 180)[:, None]
    down = np.sin(turn) * along * (1 if dial.y_down else -1)
    columns = np.floor(2 * (dial.x + np.cos(turn) * along)).astype(np.intp)
    rows = np.floor(fine * (dial.y + down / 2)).astype(np.intp)
    inside = (columns >= 0) & (columns < 2 * width) & (rows >= 0) & (rows < fine * height)
    rays = np.where(inside, rows * 2 * width + columns, -1)
    return bin_of, share, rays, (along - dial.ring) / (dial.rim - dial.ring)


QUADRANTS = np.array(list(" ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"))
QUARTER = np.array([[1, 2], [4, 8]])


def draw_dial(
    canvas: Canvas,
    panel: PlotArea,
    dial: Dial,
    bars: Bars,
    cursor: float | None,
    mark: BrushShape | None,
    colour: Rgb,
) -> None:
    """Draw bars of the selected in `colour` on grey bars of all; `cursor` in degrees."""
    chart = Canvas(panel.width, panel.height, canvas.options)
    if mark is not None:
        _ground(chart, dial, mark)
    size = (panel.width, panel.height)
    highlighted, grey = bars
    blocks = bar_dots(dial, *size, highlighted, fine=2)
    dots = bar_dots(dial, *size, grey)
    if canvas.options.ascii:
        _characters(chart, dial, cells_with_dots(blocks, 2), cells_with_dots(dots), colour)
    else:
        _dots_and_blocks(chart, dial, blocks, dots, colour)
    _needle(chart, dial, cursor)
    canvas.paste(chart, panel.x, panel.y)
    _rim(canvas, panel, cursor, mark)


def _dots_and_blocks(chart: Canvas, dial: Dial, highlighted: Dots, grey: Dots, colour: Rgb) -> None:
    """Selected bars in quarter blocks; ring and grey bars in braille dots."""
    theme = chart.theme
    ring = ring_dots(dial, chart.width, chart.height)
    draw_braille(chart, grey | ring, theme.unselected)
    parts = highlighted.reshape(chart.height, 2, chart.width, 2)
    quarters = (parts * QUARTER[None, :, None, :]).sum(axis=(1, 3))
    held = quarters > 0
    chart.char[held] = QUADRANTS[quarters[held]]
    chart.fg[held] = colour


def _characters(chart: Canvas, dial: Dial, highlighted: Dots, grey: Dots, colour: Rgb) -> None:
    """Ring, grey bars and selected bars in ASCII characters."""
    ring = cells_with_dots(ring_dots(dial, chart.width, chart.height))
    for cells, glyph, ink in (
        (ring, "o", chart.theme.muted),
        (grey, ".", chart.theme.unselected),
        (highlighted, "#", colour),
    ):
        chart.char[cells] = glyph
        chart.fg[cells] = ink


def _needle(chart: Canvas, dial: Dial, cursor: float | None) -> None:
    """A line from the centre to the ring in the heading of the cursor's instance."""
    if cursor is None:
        return
    if chart.options.ascii:
        arrow = heading_arrow(np.radians(cursor), dial.y_down, chart.glyphs)[0]
        chart.put(int(dial.x), int(dial.y), arrow, chart.theme.cursor, bold=True)
        return
    end = dial.to_cells(cursor, 0.0)
    draw_braille(
        chart, line_dots([((dial.x, dial.y), end)], chart.width, chart.height), chart.theme.cursor
    )


def _ground(chart: Canvas, dial: Dial, mark: BrushShape) -> None:
    """The sector of a brush mark."""
    middle, half = mark_arc(mark)
    across = np.arange(chart.width) + 0.5 - dial.x
    down = 2 * (np.arange(chart.height) + 0.5 - dial.y)
    turn = np.degrees(np.arctan2((down if dial.y_down else -down)[:, None], across[None]))
    apart = np.abs(angles.wrap_degrees(turn - middle))
    chart.bg[apart <= half] = chart.theme.highlight


def _rim(canvas: Canvas, panel: PlotArea, cursor: float | None, mark: BrushShape | None) -> None:
    """The ends of a brush mark and the cursor's heading at the rim."""
    if mark is not None:
        middle, half = mark_arc(mark)
        for degrees in (middle - half, middle + half):
            _at_rim(canvas, panel, degrees, "+", canvas.theme.truth)
    if cursor is not None:
        _at_rim(canvas, panel, cursor, canvas.glyphs.cursor, canvas.theme.cursor)


def _at_rim(canvas: Canvas, panel: PlotArea, degrees: float, glyph: str, colour: Rgb) -> None:
    column, row = panel.to_cells(degrees, 1.0)
    across = min(max(int(np.floor(column)), panel.x), panel.x + panel.width - 1)
    down = min(max(int(np.floor(row)), panel.y), panel.y + panel.height - 1)
    canvas.put(across, down, glyph, colour, bold=True)
