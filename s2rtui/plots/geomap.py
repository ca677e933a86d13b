"""The geo-map: floor plan, heat, poses and errors from above, in cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds
from s2rtui.canvas.colour import Rgb, legible, turbo
from s2rtui.canvas.grid import Canvas, Size
from s2rtui.canvas.look import Look, heading_arrow
from s2rtui.canvas.raster import braille, braille_bits, dot_grid, ground, segment_dots
from s2rtui.plots.frame import MapFrame, fit
from s2rtui.plots.geomap_ground import HEAT_RAMPS, draw_ground, draw_rooms
from s2rtui.plots.geomap_model import GeoMapModel, default_view, geomap_model
from s2rtui.plots.inputs import Floats, GeoMapInput
from s2rtui.plots.legend import Part, colour_bar, draw_rows, flow, ramp_for_values, scale_bar, words
from s2rtui.plots.scale import step, tick_text, ticks


@dataclass(frozen=True, slots=True)
class GeoMapLayout:
    """The map's rectangle in cells, its frame in the world, and the legend's rows under it."""

    x: int
    y: int
    width: int
    height: int
    frame: MapFrame
    axes: bool
    legend: tuple[tuple[Part, ...], ...]


def geomap_layout(
    view: GeoMapInput,
    size: Size,
    viewport: Bounds | None = None,
    look: Look | None = None,
    model: GeoMapModel | None = None,
) -> GeoMapLayout:
    """Where the map stands in `size`; `viewport` is a world rectangle (default: the bounds)."""
    look = look or Look()
    width, height = max(1, size[0]), max(1, size[1])
    axes = width >= 40 and height >= 12
    left, below = (4, 1) if axes else (0, 0)
    area = viewport or default_view(view)
    inner = max(1, width - left)
    rough = fit(area, inner, 2 * height, view.y_down)
    parts = _legend(view, model or geomap_model(view), rough, inner, look)
    rows = flow(parts, inner)[: 0 if height < 6 else 1 if height < 18 else 2]
    rows_high = max(1, height - below - len(rows))
    frame = fit(area, inner, 2 * rows_high, view.y_down)
    legend = tuple(tuple(row) for row in rows)
    return GeoMapLayout(left, 0, inner, rows_high, frame, axes, legend)


def geomap(
    view: GeoMapInput, size: Size, look: Look | None = None, viewport: Bounds | None = None
) -> Canvas:
    """The view in `size` (columns, rows) through `viewport`, a world rectangle."""
    look = look or Look()
    canvas = Canvas(*size, theme=look.theme)
    model = geomap_model(view)
    layout = geomap_layout(view, (canvas.width, canvas.height), viewport, look, model)
    chart = Canvas(layout.width, layout.height, look.theme)
    draw_ground(chart, view, layout.frame, look)
    draw_rooms(chart, view.rooms, layout.frame, look)
    _points(chart, view, model, layout.frame, look)
    _cursor(chart, view, model, layout.frame, look)
    canvas.paste(chart, layout.x, layout.y)
    if layout.axes:
        _axes(canvas, layout, look)
    draw_rows(canvas, layout.x, layout.height + int(layout.axes), layout.legend)
    return canvas


def _legend(
    view: GeoMapInput, model: GeoMapModel, frame: MapFrame, width: int, look: Look
) -> list[Part]:
    theme, glyphs = look.theme, look.glyphs
    parts: list[Part] = []
    bar = 12 if width >= 50 else 8
    if view.mode == "full":
        marks = (
            (f"{glyphs.sim} ", theme.sim),
            ("sim  ", theme.muted),
            (f"{glyphs.real} ", theme.real),
            ("real  ", theme.muted),
            (f"{glyphs.truth} ", theme.truth),
            ("truth", theme.muted),
        )
        parts.append(words(marks))
    else:
        ramp = ramp_for_values(look)
        parts.append(
            colour_bar(
                view.value_label,
                view.value_unit,
                model.value_range,
                look,
                bar,
                ramp=ramp,
                room=width,
            )
        )
    if model.heat_range is not None:
        ramp = None if look.fine else HEAT_RAMPS[look.ascii]
        parts.append(
            colour_bar(
                view.heat_label, view.heat_unit, model.heat_range, look, bar, ramp=ramp, room=width
            )
        )
    parts.append(scale_bar(frame.pitch, max(4, width // 6), look))
    if model.grey.any():
        grey = "⠿" if not look.ascii else glyphs.unselected
        parts.append(words(((f"{grey} ", theme.unselected), ("not selected", theme.muted))))
    return parts


def _topmost(
    frame: MapFrame, points: Floats
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Cell columns and rows that hold points, and the index of the last point in each."""
    cells = frame.to_cells(points)
    with np.errstate(invalid="ignore"):
        seen = (cells >= 0).all(axis=1) & (cells < (frame.width, frame.height // 2)).all(axis=1)
    index = np.flatnonzero(seen)
    columns, rows = cells[index].astype(np.intp).T
    last = np.full((frame.height // 2, frame.width), -1, dtype=np.intp)
    last[rows, columns] = index
    rows, columns = np.nonzero(last >= 0)
    return columns, rows, last[rows, columns]


def _stamp(
    canvas: Canvas, frame: MapFrame, points: Floats, glyph: str, colour: Rgb, bold: bool = True
) -> None:
    """A glyph at each point."""
    columns, rows, _ = _topmost(frame, points)
    ground(canvas, columns, rows)
    canvas.char[rows, columns] = glyph
    canvas.bold[rows, columns] = bold
    canvas.fg[rows, columns] = colour


def _stamp_values(
    canvas: Canvas, frame: MapFrame, points: Floats, shares: NDArray[np.float64], look: Look
) -> None:
    """Points coloured by value, the last one of a cell on top; digits where colours lack."""
    columns, rows, index = _topmost(frame, points)
    ground(canvas, columns, rows)
    shares = shares[index]
    shown = np.isfinite(shares)
    ink = legible(turbo(shares), look.theme)
    ink[~shown] = look.theme.text
    canvas.char[rows, columns] = look.glyphs.selected
    if (digits := ramp_for_values(look)) is not None:
        place = np.clip(np.nan_to_num(shares) * len(digits), 0, len(digits) - 1).astype(np.intp)
        canvas.char[rows, columns] = np.where(shown, np.array(list(digits))[place], "?")
    canvas.bold[rows, columns] = True
    canvas.fg[rows, columns] = ink


def _points(
    canvas: Canvas, view: GeoMapInput, model: GeoMapModel, frame: MapFrame, look: Look
) -> None:
    theme, glyphs = look.theme, look.glyphs
    grey = np.asarray(view.truth)[model.grey]
    if look.ascii:
        _stamp(canvas, frame, grey, glyphs.unselected, theme.unselected, bold=False)
    else:
        cells = frame.to_cells(grey)
        cells = cells[np.isfinite(cells).all(axis=1)]
        dots = dot_grid(cells[:, 0], cells[:, 1], canvas.width, canvas.height)
        braille(canvas, 0, 0, dots, np.array(theme.unselected, dtype=np.uint8))
    if view.mode == "full":
        _lines(canvas, view, model, frame, look)
        for points, glyph, colour in (
            (view.sim, glyphs.sim, theme.sim),
            (view.real, glyphs.real, theme.real),
            (view.truth, glyphs.truth, theme.truth),
        ):
            _stamp(canvas, frame, np.asarray(points)[model.order], glyph, colour)
        return
    lit = np.asarray(view.truth)[model.order]
    _stamp_values(canvas, frame, lit, model.fraction[model.order], look)


def _lines(
    canvas: Canvas, view: GeoMapInput, model: GeoMapModel, frame: MapFrame, look: Look
) -> None:
    """From the truth of `model.lines` to both predictions, in braille or in full stops."""
    theme = look.theme
    starts = frame.to_cells(np.asarray(view.truth)[model.lines])
    for side, colour in ((view.sim, theme.sim), (view.real, theme.real)):
        dots = np.zeros((4 * canvas.height, 2 * canvas.width), dtype=np.bool_)
        ends = frame.to_cells(np.asarray(side)[model.lines])
        for start, end in zip(starts, ends, strict=True):
            if np.isfinite(start).all() and np.isfinite(end).all():
                columns, rows = segment_dots(start[0], start[1], end[0], end[1])
                dots |= dot_grid(columns, rows, canvas.width, canvas.height)
        if look.ascii:
            for row, column in np.argwhere(braille_bits(dots)):
                canvas.put(int(column), int(row), ".", colour)
        else:
            braille(canvas, 0, 0, dots, np.array(colour, dtype=np.uint8))


def _cursor(
    canvas: Canvas, view: GeoMapInput, model: GeoMapModel, frame: MapFrame, look: Look
) -> None:
    """The cursor's pose with its heading; in mode "full" its two predictions with theirs."""
    iid = model.cursor
    if iid is None:
        return
    theme, glyphs = look.theme, look.glyphs
    marks = [(view.truth, view.headings, glyphs.cursor, theme.cursor)]
    if view.mode == "full":
        marks.insert(0, (view.sim, view.sim_headings, glyphs.sim, theme.sim))
        marks.insert(1, (view.real, view.real_headings, glyphs.real, theme.real))
    for points, headings, glyph, colour in marks:
        place = np.asarray(points)[iid : iid + 1]
        columns, rows, _ = _topmost(frame, place)
        if not columns.size:
            continue
        _stamp(canvas, frame, place, glyph, colour)
        if headings is not None and np.isfinite(headings[iid]):
            arrow, across, down = heading_arrow(float(headings[iid]), view.y_down, glyphs)
            column, row = int(columns[0]) + across, int(rows[0]) + down
            if 0 <= column < canvas.width and 0 <= row < canvas.height:
                ground(canvas, np.array([column]), np.array([row]))
                canvas.put(column, row, arrow, colour, bold=True)


def _axes(canvas: Canvas, layout: GeoMapLayout, look: Look) -> None:
    """Ticks in metres along the left and the lower edge."""
    theme, frame = look.theme, layout.frame
    extent, bottom = frame.extent, layout.height
    count = max(2, layout.width // 12)
    width = step(extent.width, count)
    canvas.text(0, 0, "y m", theme.muted)
    name = "x m"
    free, stop = layout.x, canvas.width - len(name) - 1
    for tick in ticks(extent.x0, extent.x1, count):
        column = layout.x + int(frame.to_cells([[tick, frame.y0]])[0, 0])
        text = tick_text(tick, width)
        start = column - len(text) // 2
        if start >= free and start + len(text) <= stop:
            free = canvas.text(start, bottom, text, theme.muted) + 1
    canvas.text(canvas.width - len(name), bottom, name, theme.muted)
    count = max(2, layout.height // 5)
    width = step(extent.height, count)
    for tick in ticks(extent.y0, extent.y1, count):
        row = int(frame.to_cells([[frame.x0, tick]])[0, 1])
        if 1 <= row < bottom:
            canvas.text(layout.x - 1, row, tick_text(tick, width)[:4], theme.muted, align="right")
