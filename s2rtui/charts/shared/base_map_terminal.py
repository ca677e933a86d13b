"""Maps in cells: layout, axes, legend, and the drawing that all maps share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds
from s2rtui.analysis.binning import Bools, SelectionIndices
from s2rtui.analysis.map_frame import MapFrame, fit_frame
from s2rtui.canvas import (
    BrushShape,
    Canvas,
    Pixels,
    PlotArea,
    Point,
    RenderOptions,
    Rgb,
    Size,
    heading_arrow,
)
from s2rtui.canvas.marks import draw_mark
from s2rtui.canvas.raster import braille_bits, draw_braille, limit_ground
from s2rtui.charts.shared.base_map_background import (
    MapBackground,
    draw_background,
)
from s2rtui.charts.shared.base_map_model import MapInput, MapModel, default_view, map_model
from s2rtui.charts.shared.base_map_pixels import (
    MapPicture,
    add_picture,
    map_picture,
    paint_cursor,
    paint_trained,
    paint_values,
)
from s2rtui.charts.shared.base_map_room_names import draw_room_names, mark_costs
from s2rtui.charts.shared.point_bins import (
    highest_levels,
    level_shares,
    marked_cells,
    unselected_dots,
)
from s2rtui.drawing.heat_colours import heat_glyphs, heat_ramp
from s2rtui.drawing.legend import (
    LegendPart,
    colour_bar,
    draw_rows,
    fit_rows,
    legend_rows,
    point_colours,
    ramp_for_values,
    scale_bar,
    text_part,
)
from s2rtui.drawing.scale import Floats, tick_step, tick_text, tick_values
from s2rtui.drawing.trained_marks import SEVERAL as SEVERAL_TRAINED
from s2rtui.drawing.trained_marks import (
    TrainedForms,
    digit_forms,
    glyph_forms,
    mark_trained,
    trained_legend,
)

Places = NDArray[np.intp]
Legend = Callable[[MapFrame, int], list[LegendPart]]
"""Returns the parts of a legend for a frame, each within a width."""
ModeLegend = Callable[[MapInput, MapModel, RenderOptions, int], list[LegendPart]]
"""The legend parts that explain the selected points of a map, within a width."""


@dataclass(frozen=True, slots=True)
class SelectedMarks:
    """The marks of the selected points: drawn in cells, and painted in true pixels.

    `key` is equal only for equal maps. Characters of `texts` in cells stay texts in true pixels.
    """

    draw: Callable[[Canvas], None]
    paint: Callable[[MapPicture], None]
    key: tuple[object, ...]
    texts: str = ""


@dataclass(frozen=True, slots=True)
class MapLayout:
    """The map's rectangle in cells, its frame in metres, and the rows of the legend below."""

    x: int
    y: int
    width: int
    height: int
    frame: MapFrame
    axes: bool
    legend: tuple[tuple[LegendPart, ...], ...]


class PointMap(Protocol):
    """The common fields of all inputs of maps; truth: (N, 2) metres."""

    @property
    def truth(self) -> Floats: ...
    @property
    def ground(self) -> MapBackground: ...
    @property
    def mark(self) -> BrushShape | None: ...


def layout_of_area(area: Bounds, y_down: bool, size: Size, legend: Legend) -> MapLayout:
    """Lay out a map of `area`; larger views have axes and more rows of legend."""
    width, height = max(1, size[0]), max(1, size[1])
    axes = width >= 40 and height >= 12
    left, below = (4, 1) if axes else (0, 0)
    inner = max(1, width - left)
    rough = fit_frame(area, inner, 2 * height, y_down)
    rows = fit_rows(legend(rough, inner), inner, most=legend_rows(height))
    rows_high = max(1, height - below - len(rows))
    frame = fit_frame(area, inner, 2 * rows_high, y_down)
    return MapLayout(left, 0, inner, rows_high, frame, axes, tuple(tuple(row) for row in rows))


def map_panel(layout: MapLayout) -> PlotArea:
    """The panel of a map: a plane in metres."""
    return plane_panel("map", layout.x, layout.y, layout.width, layout.height, layout.frame)


def plane_panel(
    name: str, left: int, top: int, width: int, height: int, frame: MapFrame
) -> PlotArea:
    """A brushable panel with x and y coordinates that covers a map frame."""

    def to_data(column: float, row: float) -> Point:
        return frame.to_world(column - left - 0.5, row - top - 0.5)

    def to_cells(x: float, y: float) -> Point:
        column, row = frame.to_cells([[x, y]])[0].tolist()
        return column + left, row + top

    return PlotArea(name, "plane", left, top, width, height, to_data, to_cells)


def draw_axes(canvas: Canvas, layout: MapLayout) -> None:
    """Draw ticks in metres along the left and the lower edge."""
    theme, frame = canvas.theme, layout.frame
    extent, bottom = frame.extent, layout.height
    count = max(2, layout.width // 12)
    width = tick_step(extent.width, count)
    canvas.text(0, 0, "y m", theme.muted)
    name = "x m"
    free, stop = layout.x, canvas.width - len(name) - 1
    for tick in tick_values(extent.x0, extent.x1, count):
        column = layout.x + int(frame.to_cells([[tick, frame.y0]])[0, 0])
        text = tick_text(tick, width)
        start = column - len(text) // 2
        if start >= free and start + len(text) <= stop:
            free = canvas.text(start, bottom, text, theme.muted) + 1
    canvas.text(canvas.width - len(name), bottom, name, theme.muted)
    count = max(2, layout.height // 5)
    width = tick_step(extent.height, count)
    for tick in tick_values(extent.y0, extent.y1, count):
        row = int(frame.to_cells([[frame.x0, tick]])[0, 1])
        if 1 <= row < bottom:
            canvas.text(layout.x - 1, row, tick_text(tick, width)[:4], theme.muted, align="right")


def draw_dots(canvas: Canvas, grid: NDArray[np.bool_], colour: Rgb, glyph: str = "") -> None:
    """Draw braille dots (4 rows, 2 columns per cell); in ASCII a glyph per cell."""
    if not canvas.options.ascii:
        draw_braille(canvas, grid, colour)
        return
    rows, columns = np.nonzero(braille_bits(grid))
    put_glyphs(canvas, columns, rows, glyph or canvas.glyphs.unselected, colour, bold=False)


def put_glyphs(
    canvas: Canvas, columns: Places, rows: Places, glyph: str, colour: Rgb, bold: bool = True
) -> None:
    """Put a glyph into each of some cells."""
    canvas.char[rows, columns] = glyph
    canvas.bold[rows, columns] = bold
    canvas.fg[rows, columns] = colour


def put_marks(canvas: Canvas, counts: Places, glyph: str, several: str, colour: Rgb) -> None:
    """Put a glyph into each cell with one instance, and `several` into those with more.

    counts: (rows, columns) instances per cell. Without colours or in ASCII, cells with several
    instances are bold instead.
    """
    rows, columns = np.nonzero(counts)
    put_glyphs(canvas, columns, rows, glyph, colour)
    many = counts[rows, columns] > 1
    if ramp_for_values(canvas.options) is not None:
        canvas.bold[rows, columns] = many
    else:
        canvas.char[rows[many], columns[many]] = several


def several_legend(options: RenderOptions, glyphs: str = "") -> LegendPart:
    """The legend of cells with several instances; `glyphs` as given to `put_marks`."""
    theme = options.theme
    if ramp_for_values(options) is not None:
        return text_part((("bold: several", theme.muted),))
    glyphs = glyphs or options.glyphs.several
    return text_part(((f"{glyphs} ", theme.text), ("several", theme.muted)))


def draw_values(canvas: Canvas, data: MapInput, model: MapModel, frame: MapFrame) -> None:
    """Draw the selected points by the largest value per cell, in colours or digits."""
    cells = highest_levels(data.truth, data.values, model.value_range, model.selection, frame)
    rows, columns = np.nonzero(cells.count)
    shares = level_shares(cells.level[rows, columns])
    known = np.isfinite(shares)
    glyphs = canvas.glyphs
    put_marks(canvas, cells.count, glyphs.selected, glyphs.several, canvas.theme.text)
    if (digits := ramp_for_values(canvas.options)) is not None:
        steps = np.clip(np.nan_to_num(shares) * len(digits), 0, len(digits) - 1).astype(np.intp)
        canvas.char[rows, columns] = np.where(known, np.array(list(digits))[steps], "?")
    canvas.fg[rows[known], columns[known]] = point_colours(canvas.theme)(shares[known])


def draw_trained(
    canvas: Canvas, points: Floats, trained: Bools | None, selection: SelectionIndices,
    frame: MapFrame, marks: TrainedForms,
) -> None:  # fmt: skip
    """Mark the glyphs of cells that hold a selected instance that the model was trained on."""
    if trained is not None:
        mark_trained(canvas, marked_cells(points, trained, selection, frame), marks)


def value_marks(options: RenderOptions) -> TrainedForms:
    """The forms of trained instances among those that `draw_values` draws."""
    if ramp_for_values(options) is not None:
        return digit_forms(options)
    glyphs = options.glyphs
    return glyph_forms(
        glyphs.selected + glyphs.several, glyphs.trained + SEVERAL_TRAINED,
        f"{glyphs.trained} {SEVERAL_TRAINED}",
    )  # fmt: skip


def draw_pose(
    canvas: Canvas, points: Floats, headings: Floats | None, iid: int, frame: MapFrame, role: str
) -> None:
    """Draw the glyph of a role at one of `points` (N, 2), and an arrow if its heading is known."""
    glyph, colour = canvas.options.role(role)
    place = frame.to_cells(np.asarray(points)[iid])[0]
    if not (np.isfinite(place).all() and (place >= 0).all()):
        return
    column, row = int(place[0]), int(place[1])
    if column >= canvas.width or row >= canvas.height:
        return
    one = np.array([column]), np.array([row])
    put_glyphs(canvas, *one, glyph, colour)
    if headings is not None and np.isfinite(headings[iid]):
        arrow, across, down = heading_arrow(float(headings[iid]), frame.y_down, canvas.glyphs)
        column, row = column + across, row + down
        if 0 <= column < canvas.width and 0 <= row < canvas.height:
            put_glyphs(canvas, np.array([column]), np.array([row]), arrow, colour)


def layout_of_points(
    data: MapInput,
    model: MapModel,
    size: Size,
    viewport: Bounds | None,
    options: RenderOptions,
    mode_legend: ModeLegend | None = None,
    notes: Sequence[LegendPart] = (),
    marks: TrainedForms | None = None,
) -> MapLayout:
    """Lay out a map whose selected points `mode_legend` explains (default: `value_legend`).

    `viewport` is a world rectangle, by default the bounds. `notes` close the legend. `marks` are
    the forms of trained instances, by default those of `value_marks`.
    """
    explain = mode_legend or value_legend

    def legend(frame: MapFrame, width: int) -> list[LegendPart]:
        parts = explain(data, model, options, width)
        if data.trained is not None:
            parts.append(trained_legend(options, marks or value_marks(options)))
        if model.heat_range is not None:
            colours = heat_ramp(data.heat_is_signed)
            ramp = None if options.supports_shading else heat_glyphs(options, data.heat_is_signed)
            length = 12 if width >= 50 else 8
            heat = data.heat_label, data.heat_unit, model.heat_range
            parts.append(colour_bar(*heat, options, length, colours, ramp, width))
        return parts + map_legend(frame, width, model.others, data.clip is not None, options, notes)

    area = viewport or default_view(data.bounds, data.truth, data.valid)
    return layout_of_area(area, data.y_down, size, legend)


def value_legend(
    data: MapInput, model: MapModel, options: RenderOptions, width: int
) -> list[LegendPart]:
    """The colour bar of the points' values, if they have any."""
    if not data.value_label:
        return []
    ramp, length = ramp_for_values(options), 12 if width >= 50 else 8
    values = data.value_label, data.value_unit, model.value_range
    clipped, colours = data.value_range is None, point_colours(options.theme)
    bar = colour_bar(*values, options, length, colours, ramp, width, clipped)
    return [bar, several_legend(options)] if model.highlighted > 1 else [bar]


def map_legend(
    frame: MapFrame,
    width: int,
    others: int,
    clipped: bool,
    options: RenderOptions,
    notes: Sequence[LegendPart] = (),
) -> list[LegendPart]:
    """Legend parts of every map: scale bar, unselected points, notes, dimmed floor."""
    theme = options.theme
    parts = [scale_bar(frame.pitch, max(4, width // 6), options)]
    if others:
        grey = "⠿" if not options.ascii else options.glyphs.unselected
        parts.append(text_part(((f"{grey} ", theme.unselected), ("not selected", theme.muted))))
    parts += notes
    if clipped:
        how = "dim" if options.supports_shading else "blank"
        parts.append(text_part(((f"{how}: not seen", theme.muted),)))
    return parts


def draw_point_map(
    data: PointMap,
    selection: SelectionIndices,
    layout: MapLayout,
    size: Size,
    options: RenderOptions,
    marks: SelectedMarks,
) -> Canvas:
    """A map in `size` (columns, rows): floor, unselected points, the selected, names of rooms.

    Every glyph gets a ground that it stands out from.
    """
    canvas = Canvas(*size, options)
    chart, frame = Canvas(layout.width, layout.height, options), layout.frame
    ground = data.ground
    draw_background(chart, ground, frame)
    draw_dots(chart, unselected_dots(data.truth, selection, frame), options.theme.unselected)
    before = Canvas(layout.width, layout.height, options)
    before.paste(chart, 0, 0)
    marks.draw(chart)
    text = np.isin(chart.char, list(marks.texts))
    unnamed = chart.char.copy()
    draw_room_names(chart, ground.rooms, frame, mark_costs(before, chart))
    text |= chart.char != unnamed
    if options.supports_shading:

        def paint(size: Size) -> Pixels:
            picture = map_picture(ground, frame, options.theme, data.truth, selection, size)
            marks.paint(picture)
            return picture.image

        add_picture(chart, (*marks.key, frame, options.theme), paint, text)
    canvas.paste(chart, layout.x, layout.y)
    if layout.axes:
        draw_axes(canvas, layout)
    draw_rows(canvas, layout.x, layout.height + int(layout.axes), layout.legend)
    unmarked = canvas.char.copy()
    draw_mark(canvas, map_panel(layout), data.mark)
    canvas.show_text(canvas.char != unmarked)
    limit_ground(canvas)
    return canvas


def draw_value_map(
    data: MapInput, size: Size, options: RenderOptions, viewport: Bounds | None
) -> Canvas:
    """A map in `size` whose selected points are coloured by their values."""
    model = map_model(data)
    layout = layout_of_points(data, model, size, viewport, options)

    def draw_selected(chart: Canvas) -> None:
        draw_values(chart, data, model, layout.frame)
        forms = value_marks(options)
        draw_trained(chart, data.truth, data.trained, model.selection, layout.frame, forms)
        draw_cursor(chart, data, model.cursor, layout.frame)

    def paint_selected(picture: MapPicture) -> None:
        paint_values(picture, data, model)
        paint_trained(picture, data, model)
        paint_cursor(picture, data, model.cursor)

    marks = SelectedMarks(draw_selected, paint_selected, (replace(data, mark=None),))
    return draw_point_map(data, model.selection, layout, size, options, marks)


def draw_cursor(canvas: Canvas, data: MapInput, cursor: int | None, frame: MapFrame) -> None:
    """The true pose of the cursor's instance."""
    if cursor is not None:
        draw_pose(canvas, data.truth, data.headings, cursor, frame, "cursor")
