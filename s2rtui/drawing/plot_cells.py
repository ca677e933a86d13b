"""Draw the marks of a plot in character cells, and dials: plots whose x are degrees of a turn."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry import angles
from s2rtui.canvas import BrushShape, Canvas, PlotArea, Point, RenderOptions, Rgb, heading_arrow
from s2rtui.canvas.marks import mark_arc, mark_on_panel
from s2rtui.canvas.raster import cells_with_dots, dot_grid, draw_braille, segment_dots
from s2rtui.drawing.arcs import number_cells
from s2rtui.drawing.bars import draw_vertical_bars, put_over_bar
from s2rtui.drawing.image import Image
from s2rtui.drawing.image_cells import draw_image
from s2rtui.drawing.plane_cells import PLANE_DRAWINGS, draw_names
from s2rtui.drawing.plane_marks import GROUND
from s2rtui.drawing.plot import ROLES, Bars, Dots, Ink, Line, Plot, Points, Rule
from s2rtui.drawing.points_cells import draw_points
from s2rtui.drawing.scale import Scale, short_number

_ROUNDING = 1e-9
"""Fractions of a scale this far beyond its ends lie at them."""
_DASH = 4
"""Dots of a dash and its gap."""


def draw_marks(canvas: Canvas, plot: Plot) -> NDArray[np.bool_]:
    """Draw the marks of a plot on the whole canvas.

    Returns the cells (h, w) whose characters stay texts over a picture of the marks.
    """
    ground: Canvas | None = None
    for each in plot.marks:
        if ground is None and not isinstance(each, GROUND):
            ground = _copy(canvas)
        if (draw := _DRAWINGS.get(type(each))) is not None:
            draw(canvas, plot, each)
    return number_cells(canvas, plot) | draw_names(canvas, plot, ground or canvas)


def _copy(canvas: Canvas) -> Canvas:
    copy = Canvas(canvas.width, canvas.height, canvas.options)
    copy.paste(canvas, 0, 0)
    return copy


def _draw_points(canvas: Canvas, plot: Plot, points: Points) -> None:
    """The cells of points, and the sign of the cursor's instance."""
    draw_points(canvas, plot, points)
    if points.cursor is None:
        return
    x, y = float(points.x[points.cursor]), float(points.y[points.cursor])
    places = plot.x.fraction(x), plot.y.fraction(y)
    if all(0 <= place <= 1 for place in places):
        at = column_of(plot.x, x, canvas.width), row_of(plot.y, y, canvas.height)
        canvas.put(*at, *canvas.options.role("cursor"), bold=True)


def style_of(canvas: Canvas, mark: Line | Dots) -> tuple[str, Rgb]:
    """The glyph and the colour of a mark."""
    sign: str | None = mark.sign if isinstance(mark, Dots) else None
    sign = sign or (mark.ink if mark.ink in ROLES else "unselected")
    return getattr(canvas.glyphs, sign), _ink(canvas, mark.ink)


def _ink(canvas: Canvas, ink: Ink) -> Rgb:
    colour: Rgb = getattr(canvas.theme, ink)
    return colour


def column_of(scale: Scale, x: float, width: int) -> int:
    """The column of a value, which may lie outside of the axis; its end is in the last one."""
    place = float(scale.fraction(x)) * width
    return width - 1 if abs(place - width) < 1e-9 else int(np.floor(place + 1e-9))


def row_of(scale: Scale, y: float, height: int) -> int:
    """The row of a value from the top; values beyond the axis are in the first or the last row."""
    place = float(scale.fraction(y)) * height
    return height - 1 - int(np.clip(np.floor(place + 1e-9), 0, height - 1))


def _draw_bars(canvas: Canvas, plot: Plot, bars: Bars) -> None:
    """A bar in each column, that of the interval in which the middle of the column lies."""
    middles = plot.x.value((np.arange(canvas.width) + 0.5) / canvas.width)
    places = np.searchsorted(bars.edges, middles, side="right") - 1
    inside = (places >= 0) & (places < bars.part.size)
    held = np.where(inside, places, 0)
    part, whole = (
        np.where(inside, plot.y.fraction(counts[held]), 0.0) for counts in (bars.part, bars.whole)
    )
    draw_vertical_bars(canvas, (part, whole), _ink(canvas, bars.ink))


def _draw_line(canvas: Canvas, plot: Plot, line: Line) -> None:
    """Braille dots, in ASCII a glyph in every second column; nothing beyond the scale of y."""
    if not line.x.size:
        return
    width, height = canvas.width, canvas.height
    fractions = (np.arange(2 * width) + 0.5) / (2 * width)
    values = np.interp(plot.x.value(fractions), line.x, line.y, left=np.nan, right=np.nan)
    up = plot.y.fraction(values)
    up = np.where((up >= -_ROUNDING) & (up <= 1 + _ROUNDING), up, np.nan)
    heights = np.clip((1 - up) * height, 0, height - 1e-6)
    glyph, colour = style_of(canvas, line)
    if canvas.options.ascii:
        for column in range(0, width, 4 if line.dashed else 2):
            if np.isfinite(heights[2 * column]):
                canvas.put(column, int(heights[2 * column]), glyph, colour)
        return
    steps = np.linspace(0, 1, 4 * height)[:, None]
    joined = heights[:-1] + (heights[1:] - heights[:-1]) * steps
    across = np.broadcast_to(fractions[1:] * width, joined.shape)
    drawn: NDArray[np.bool_] = np.isfinite(joined)
    if line.dashed:
        drawn &= np.arange(joined.shape[1]) % _DASH < _DASH // 2
    draw_braille(canvas, dot_grid(across[drawn], joined[drawn], width, height), colour)


def _draw_dots(canvas: Canvas, plot: Plot, dots: Dots) -> None:
    """Signs with their intervals; an arrow with the number where y is beyond the scale."""
    glyph, colour = style_of(canvas, dots)
    beyond: list[tuple[int, int, float]] = []
    places = plot.x.fraction(dots.x)
    for place, x in enumerate(dots.x.tolist()):
        y = float(dots.y[place])
        if not (np.isfinite(y) and 0 <= places[place] <= 1):
            continue
        column, row = column_of(plot.x, x, canvas.width), row_of(plot.y, y, canvas.height)
        if dots.low is not None and dots.high is not None and dots.shift == 1.0:
            _draw_span(canvas, plot, column, (float(dots.low[place]), float(dots.high[place])),
                       colour)  # fmt: skip
        if plot.y.low <= y <= plot.y.high:
            put_over_bar(canvas, column, row, glyph, colour)
        else:
            canvas.put(column, row, canvas.glyphs.arrows[6 if y > plot.y.high else 2], colour,
                       bold=True)  # fmt: skip
            beyond.append((column, row, y))
    for column, row, y in reversed(beyond):
        _write_beside(canvas, column, row, short_number(y), colour)


def _draw_span(
    canvas: Canvas, plot: Plot, column: int, bounds: tuple[float, float], colour: Rgb
) -> None:
    """A vertical line between two values; an arrow at an end beyond the scale."""
    if not np.isfinite(bounds).all():
        return
    low, high = (row_of(plot.y, end, canvas.height) for end in bounds)
    canvas.vline(column, high, low, canvas.glyphs.vertical, colour)
    for row, is_beyond, arrow in (
        (high, bounds[1] > plot.y.high, 6), (low, bounds[0] < plot.y.low, 2)
    ):  # fmt: skip
        if is_beyond:
            canvas.put(column, row, canvas.glyphs.arrows[arrow], colour, bold=True)


def _write_beside(canvas: Canvas, column: int, row: int, text: str, colour: Rgb) -> None:
    """Write a text beside a cell where the cells are free."""
    for start in (column + 1, column - len(text)):
        around = canvas.char[row, max(0, start) : start + len(text)]
        if start >= 0 and start + len(text) <= canvas.width and (around == " ").all():
            canvas.text(start, row, text, colour)
            return


def _draw_rule(canvas: Canvas, plot: Plot, rule: Rule) -> None:
    """A line across the plot, over bars; beyond the end of the axis it is at that end."""
    colour, glyphs = _ink(canvas, rule.ink), canvas.glyphs
    if rule.axis == "x":
        column = int(np.clip(column_of(plot.x, rule.at, canvas.width), 0, canvas.width - 1))
        for row in range(canvas.height):
            glyph = glyphs.baseline if rule.dashed else glyphs.vertical
            put_over_bar(canvas, column, row, glyph, colour, bold=rule.dashed)
    else:
        row = row_of(plot.y, rule.at, canvas.height)
        canvas.hline(0, canvas.width - 1, row, glyphs.horizontal, colour)


def _draw_image(canvas: Canvas, plot: Plot, image: Image) -> None:
    draw_image(canvas, image)


_DRAWINGS: dict[type, Callable[[Canvas, Plot, Any], None]] = {
    Bars: _draw_bars, Line: _draw_line, Dots: _draw_dots, Points: _draw_points, Rule: _draw_rule,
    Image: _draw_image, **PLANE_DRAWINGS,
}  # fmt: skip
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
        _draw_dial_bars(canvas, dial, plot, bars)
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


def _draw_dial_bars(canvas: Canvas, dial: Dial, plot: Plot, bars: Bars) -> None:
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
