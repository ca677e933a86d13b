"""The headings in cells: three dials, or strips of bars where they are too small."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from s2rstore.geometry import angles
from s2rtui.canvas import (
    DEFAULT_OPTIONS,
    BrushShape,
    Canvas,
    PlotArea,
    Point,
    RenderOptions,
    Rgb,
    Size,
)
from s2rtui.canvas.marks import mark_arc, mark_on_panel, wrap_degrees
from s2rtui.charts.orientation.dial import Dial, dial_of, draw_dial
from s2rtui.charts.orientation.model import (
    BINS,
    NAMES,
    Headings,
    OrientationInput,
    OrientationModel,
    orientation_model,
)
from s2rtui.drawing.bars import Bars, draw_vertical_bars, put_over_bar
from s2rtui.drawing.scale import short_number

SMALLEST = 6.0
"""Smallest radius of a dial in columns; in ASCII twice that."""
COARSER = (72, 36, 24, 18, 12, 9, 8, 6, 4, 3, 2, 1)
LABEL = 8
"""Columns of names at the left of a strip."""
Place = tuple[int, int, int, int]
Way = Callable[[float, float], Point]


@dataclass(frozen=True, slots=True)
class OrientationLayout:
    """Up to three rectangles (x, y, width, height) in cells for the bars, in the order of NAMES.

    dial: the disc in each rectangle, or None for strips of `count` bins. room: width of header and
    footer of a rectangle. labels: whether degrees are written around the dial.
    """

    places: tuple[Place, ...]
    dial: Dial | None
    count: int
    room: int
    header: int
    footer: int
    labels: bool


def orientation_layout(
    data: OrientationInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> OrientationLayout:
    """Lay out dials in a row or a column, whichever are larger; strips if both are too small."""
    width, height = max(1, size[0]), max(1, size[1])
    row, column = ((width - 2) // 3, height), (width, height // 3)
    stacked = _rim(*column)[0] > _rim(*row)[0]
    room, rows = column if stacked else row
    rim, header, footer, margin = _rim(room, rows)
    smallest = 2 * SMALLEST if options is not None and options.ascii else SMALLEST
    if rim < smallest:
        return _strips(width, height)
    inner = min(rows - header - footer, math.ceil(rim + 2 * margin[1]))
    top = header + (rows - header - footer - inner) // 2
    corners = [(0, index * rows) if stacked else (index * (room + 1), 0) for index in range(3)]
    places = tuple((x, y + top, room, inner) for x, y in corners)
    dial = dial_of(0, 0, room, inner, data.y_down, margin)
    return OrientationLayout(places, dial, BINS, room, header, footer, margin[1] > 0)


def _rim(width: int, height: int) -> tuple[float, int, int, Point]:
    """A dial's radius in columns, rows above and below it, and the margin for its degrees."""
    header, footer = (1, 1) if height >= 10 else (int(height >= 8), 0)
    rows = height - header - footer
    margin = (3.0 if width < 32 else 4.0, 1.0) if width >= 24 and rows >= 11 else (0.0, 0.0)
    return min(width / 2 - margin[0], rows - 2 * margin[1]), header, footer, margin


def _strips(width: int, height: int) -> OrientationLayout:
    left = LABEL if width >= 36 + LABEL else 0
    footer = 1 if height >= 4 else 0
    rows = max(1, (height - footer) // 3)
    count = next(count for count in COARSER if count <= width - left)
    each = (width - left) // count
    places = tuple((left, index * rows, count * each, rows) for index in range(min(3, height)))
    return OrientationLayout(places, None, count, left, 0, footer, False)


def orientation_panels(
    data: OrientationInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> tuple[PlotArea, ...]:
    """Panels "sim", "truth" and "real": degrees in [-180, 180), and the radius 0 .. 1."""
    layout = orientation_layout(data, size, options)
    dial = layout.dial
    panels = []
    for name, place in zip(NAMES, layout.places, strict=False):
        to_data, to_cells = _on_strip(place) if dial is None else _on_dial(dial, place)
        panels.append(PlotArea(name, "turn", *place, to_data, to_cells))
    return tuple(panels)


def _on_dial(dial: Dial, place: Place) -> tuple[Way, Way]:
    x, y, _, _ = place

    def to_data(column: float, row: float) -> Point:
        return dial.to_data(column - x, row - y)

    def to_cells(degrees: float, radius: float) -> Point:
        column, row = dial.to_cells(degrees, radius)
        return column + x, row + y

    return to_data, to_cells


def _on_strip(place: Place) -> tuple[Way, Way]:
    x, y, width, height = place

    def to_data(column: float, row: float) -> Point:
        return wrap_degrees(360 * (column - x) / width - 180), (y + height - row) / height

    def to_cells(degrees: float, radius: float) -> Point:
        return x + (wrap_degrees(degrees) + 180) / 360 * width, y + height * (1 - radius)

    return to_data, to_cells


def draw_orientation(
    data: OrientationInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> Canvas:
    """The view in `size` (columns, rows)."""
    canvas = Canvas(*size, options)
    size = (canvas.width, canvas.height)
    layout = orientation_layout(data, size, options)
    model = orientation_model(data, layout.count)
    panels = orientation_panels(data, size, options)
    for panel, headings in zip(panels, model.panels, strict=False):
        bars, cursor = model.lengths(headings), headings.cursor
        mark = mark_on_panel(data.mark, panel.name)
        glyph, colour = options.role(panel.name)
        name = f"{glyph} {panel.name}", colour
        if layout.dial is not None:
            draw_dial(canvas, panel, layout.dial, bars, cursor, mark, colour)
            _label_dial(canvas, panel, layout, headings, _scale(model, layout.room - 8), name)
            continue
        draw_strip(canvas, panel, bars, cursor, mark, colour)
        if layout.room:
            canvas.text(0, panel.y, *name)
        if layout.room and panel.height > 1:
            mean = _mean(headings, layout.room - 1, options)
            canvas.text(0, panel.y + 1, mean, options.theme.muted)
    if layout.dial is None and layout.footer:
        draw_strip_axis(canvas, panels[0], _scale(model, layout.room - 1))
    return canvas


def _scale(model: OrientationModel, room: int) -> str:
    """The count of the longest bar: of the selected, and of all where it differs."""
    highlighted, whole = short_number(model.peak, 2), short_number(model.whole, 2)
    texts = [f"max {highlighted}", highlighted]
    if highlighted != whole:
        texts.insert(0, f"max {highlighted} (all {whole})")
    return next((text for text in texts if len(text) <= room), "")


def _label_dial(
    canvas: Canvas,
    panel: PlotArea,
    layout: OrientationLayout,
    headings: Headings,
    scale: str,
    name: tuple[str, Rgb],
) -> None:
    """Write name and scale above a dial, the mean below it, degrees around it."""
    theme, room = canvas.theme, layout.room
    if layout.header:
        canvas.text(panel.x, panel.y - 1, *name)
        canvas.text(panel.x + room, panel.y - 1, scale, theme.muted, align="right")
    if layout.footer:
        text = _mean(headings, room, canvas.options)
        start = panel.x + (room - len(text)) // 2
        canvas.text(start, panel.y + panel.height, text, theme.muted)
    if layout.labels:
        for degrees in (0, 90, 180, -90):
            text, flat = str(degrees), degrees in (0, 180)
            column, row = panel.to_cells(degrees, 1.0)
            start = int(column) - len(text) // 2
            if degrees == 0:
                start = int(np.ceil(column)) + 1
            elif degrees == 180:
                start = max(panel.x, int(column) - 1 - len(text))
            below = row > panel.y + panel.height / 2
            at = int(row) if flat else int(np.ceil(row)) if below else int(np.ceil(row)) - 1
            canvas.text(start, at, text, theme.muted)


def _mean(headings: Headings, room: int, options: RenderOptions) -> str:
    """Mean direction and resultant length R in at most `room` cells."""
    if not np.isfinite(headings.mean):
        return "none"[:room]
    degree = f"{int(wrap_degrees(round(headings.mean)))}{options.glyphs.degree}"
    length = f"R {headings.resultant:.2f}"
    texts = (f"mean {degree} {length}", f"{degree} {length}", degree)
    return next((text for text in texts if len(text) <= room), "")


def draw_strip(
    canvas: Canvas,
    panel: PlotArea,
    bars: Bars,
    cursor: float | None,
    mark: BrushShape | None,
    colour: Rgb,
) -> None:
    """Draw vertical bars; cursor (degrees) and ends of the brush mark on the last row."""
    bottom = panel.y + panel.height - 1
    ends: tuple[float, ...] = ()
    if mark is not None:
        middle, half = mark_arc(mark)
        turn = (np.arange(panel.width) + 0.5) / panel.width * 360 - 180
        held = np.abs(angles.wrap_degrees(turn - middle)) <= half
        rows, columns = slice(panel.y, bottom + 1), panel.x + np.flatnonzero(held)
        canvas.bg[rows, columns] = canvas.theme.highlight
        ends = (middle - half, middle + half)
    each = panel.width // len(np.asarray(bars[0]))
    highlighted, grey = (np.repeat(part, each) for part in bars)
    draw_vertical_bars(canvas, panel.x, panel.y, panel.height, (highlighted, grey), colour)
    for degrees in ends:
        canvas.put(_column(panel, degrees), bottom, "+", canvas.theme.truth, bold=True)
    if cursor is not None:
        at = _column(panel, cursor)
        put_over_bar(canvas, at, bottom, canvas.glyphs.cursor, canvas.theme.cursor)


def _column(panel: PlotArea, degrees: float) -> int:
    return min(int(panel.to_cells(degrees, 0.0)[0]), panel.x + panel.width - 1)


def draw_strip_axis(canvas: Canvas, panel: PlotArea, scale: str) -> None:
    """Draw degrees on the last row, the scale at the left."""
    row, theme, free = canvas.height - 1, canvas.theme, panel.x
    if len(scale) < panel.x:
        canvas.text(0, row, scale, theme.muted)
    for degrees in (-180, -90, 0, 90):
        text, at = str(degrees), _column(panel, degrees)
        start = at if degrees == -180 else at - len(text) // 2
        if start >= free and start + len(text) <= canvas.width:
            free = canvas.text(start, row, text, theme.muted) + 1
