"""The map in cells: values, predictions or error glyphs on the floor plan."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.canvas import (
    DEFAULT_OPTIONS,
    Canvas,
    PlotArea,
    RenderOptions,
    Size,
    heading_arrow,
    mix,
)
from s2rtui.canvas.raster import dot_grid, draw_braille, line_dots
from s2rtui.charts.map.model import (
    LARGEST,
    LINES_UP_TO,
    ErrorGlyphs,
    arc_degrees,
    arc_turns,
    error_glyphs,
    full_scale,
    iids_with_error_lines,
)
from s2rtui.charts.map.pixels import COUNTS, GLYPH_FOOTPRINT, map_key, paint_map
from s2rtui.charts.shared.base_map_model import MapInput, MapModel, map_model
from s2rtui.charts.shared.base_map_terminal import (
    MapLayout,
    Places,
    SelectedMarks,
    draw_cursor,
    draw_dots,
    draw_point_map,
    draw_pose,
    draw_trained,
    draw_values,
    layout_of_points,
    map_panel,
    put_glyphs,
    put_marks,
    several_legend,
    value_legend,
    value_marks,
)
from s2rtui.charts.shared.point_bins import selected_counts
from s2rtui.drawing.legend import LegendPart, ramp_for_values, role_legend, text_part
from s2rtui.drawing.scale import short_number
from s2rtui.drawing.trained_marks import SEVERAL as SEVERAL_TRAINED
from s2rtui.drawing.trained_marks import TrainedForms, glyph_forms, number_forms

ARROW_FOOTPRINT = (9, 3)
RADII = (3.0, 3.6, 4.2)
"""Radii of the arcs in braille dots, which makes them two dots thick."""
OCTANTS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
"""Columns and rows from the point to its arrow, in the order of `Glyphs.arrows`."""
SEVERAL = {"sim": "■", "real": "□", "truth": "●"}
"""The glyph of each role where a cell has several instances."""
Grid = NDArray[np.bool_]


def map_layout(
    data: MapInput,
    size: Size,
    viewport: Bounds | None = None,
    options: RenderOptions = DEFAULT_OPTIONS,
    model: MapModel | None = None,
) -> MapLayout:
    """Lay out the map in `size`; `viewport` is a rectangle in metres (default: the bounds)."""
    model = model or map_model(data)
    notes: list[LegendPart] = []
    if data.mode == "full" and model.highlighted > LINES_UP_TO:
        notes = [text_part(((f"error lines for up to {LINES_UP_TO}", options.theme.muted),))]
    if data.planned:
        notes.append(planned_legend(data, options))
    legend = LEGENDS[data.mode]
    forms = trained_forms(data, options)
    return layout_of_points(data, model, size, viewport, options, legend, notes, forms)


def trained_forms(data: MapInput, options: RenderOptions) -> TrainedForms:
    """The forms of the glyphs of trained instances in the map's mode."""
    mark, (truth, _) = options.glyphs.trained, options.role("truth")
    if data.mode == "glyph":
        return number_forms(options, f"{truth}·.")
    if data.mode == "colour":
        return value_marks(options)
    if ramp_for_values(options) is not None:
        return glyph_forms(truth, mark)
    return glyph_forms(
        truth + SEVERAL["truth"], mark + SEVERAL_TRAINED, f"{mark} {SEVERAL_TRAINED}"
    )


def map_panels(
    data: MapInput,
    size: Size,
    options: RenderOptions = DEFAULT_OPTIONS,
    viewport: Bounds | None = None,
) -> tuple[PlotArea, ...]:
    """One panel "map", a plane of metres."""
    return (map_panel(map_layout(data, size, viewport, options)),)


def draw_map(
    data: MapInput,
    size: Size,
    options: RenderOptions = DEFAULT_OPTIONS,
    viewport: Bounds | None = None,
) -> Canvas:
    """Draw the map in `size` (columns, rows) through `viewport`, a rectangle in metres."""
    model = map_model(data)
    layout = map_layout(data, size, viewport, options, model)

    def draw_selected(chart: Canvas) -> None:
        DRAWINGS[data.mode](chart, data, model, layout.frame)
        forms = trained_forms(data, options)
        draw_trained(chart, data.truth, data.trained, model.selection, layout.frame, forms)
        draw_planned(chart, data, layout.frame)
        for pose in data.live:
            points, headings = np.array([[pose.x, pose.y]]), np.array([pose.heading])
            draw_pose(chart, points, headings, 0, layout.frame, pose.side)
        if data.mode == "full" and model.cursor is not None:
            draw_cursor_predictions(chart, data, model.cursor, layout.frame)
        draw_cursor(chart, data, model.cursor, layout.frame)

    marks = SelectedMarks(
        draw_selected,
        lambda picture: paint_map(picture, data, model),
        map_key(data),
        COUNTS if data.mode == "glyph" else "",
    )
    return draw_point_map(data, model.selection, layout, size, options, marks)


def draw_planned(canvas: Canvas, data: MapInput, frame: MapFrame) -> None:
    """Draw an arrow at each planned pose, the first of each cell."""
    if not data.planned:
        return
    places = frame.to_cells([[pose.x_m, pose.y_m] for pose in data.planned])
    colour = canvas.theme.planned
    inside = (places >= 0).all(axis=1) & (places < (canvas.width, canvas.height)).all(axis=1)
    for number in np.flatnonzero(inside)[::-1].tolist():
        heading = np.radians(data.planned[number].heading_deg)
        arrow, _, _ = heading_arrow(float(heading), data.y_down, canvas.glyphs)
        column, row = places[number].astype(int).tolist()
        canvas.put(column, row, arrow, colour, bold=True)


def planned_legend(data: MapInput, options: RenderOptions) -> LegendPart:
    """The part that explains the arrows of planned poses."""
    theme = options.theme
    arrow = options.glyphs.arrows[0]
    words = f"{len(data.planned)} planned"
    return text_part(((f"{arrow} ", theme.planned), (words, theme.muted)))


def full_legend(
    data: MapInput, model: MapModel, options: RenderOptions, width: int
) -> list[LegendPart]:
    """The legend of predictions and truth."""
    roles = role_legend(options, sim="sim", real="real", truth="truth")
    if model.highlighted < 2:
        return [roles]
    return [roles, several_legend(options, " ".join(SEVERAL.values()))]


def draw_predictions(canvas: Canvas, data: MapInput, model: MapModel, frame: MapFrame) -> None:
    """Draw predictions and truth of the selected, joined by lines where they are few."""
    _lines(canvas, data, iids_with_error_lines(data, model, frame), frame)
    for role in ("sim", "real", "truth"):
        counts = selected_counts(getattr(data, role), model.selection, frame)
        glyph, colour = canvas.options.role(role)
        put_marks(canvas, counts, glyph, SEVERAL.get(role, glyph), colour)


def _lines(canvas: Canvas, data: MapInput, ids: Places, frame: MapFrame) -> None:
    """Error lines from the side's truth to each prediction, in braille or in full stops."""
    for start, end, colour in (
        (data.true_positions("sim"), data.sim, canvas.theme.sim),
        (data.true_positions("real"), data.real, canvas.theme.real),
    ):
        ends = [frame.to_cells(np.asarray(points)[ids]) for points in (start, end)]
        lines = np.stack(ends, axis=1)
        known = lines[np.isfinite(lines).all(axis=(1, 2))].tolist()
        draw_dots(canvas, line_dots(known, canvas.width, canvas.height), colour, ".")


def draw_cursor_predictions(canvas: Canvas, data: MapInput, cursor: int, frame: MapFrame) -> None:
    """Both predicted poses of the cursor's instance."""
    draw_pose(canvas, data.sim, data.sim_headings, cursor, frame, "sim")
    draw_pose(canvas, data.real, data.real_headings, cursor, frame, "real")


def draw_error_glyphs(canvas: Canvas, data: MapInput, model: MapModel, frame: MapFrame) -> None:
    """Draw errors as arcs in braille, or as arrows with letters and sizes without colours."""
    footprint = GLYPH_FOOTPRINT if canvas.options.supports_images else ARROW_FOOTPRINT
    glyph_set = error_glyphs(data, model, frame, footprint)
    rows, columns = np.nonzero(selected_counts(data.truth, model.selection, frame))
    glyph, colour = canvas.options.role("truth")
    if glyph_set.crowded:
        glyph = "." if canvas.options.ascii else "·"
        red, green, blue = mix(canvas.theme.background, colour, 0.55).tolist()
        colour = red, green, blue
    put_glyphs(canvas, columns, rows, glyph, colour, bold=False)
    draw = _arcs if canvas.options.supports_images else _arrows
    draw(canvas, glyph_set, data.y_down)
    _middles(canvas, glyph_set)


def _middles(canvas: Canvas, glyph_set: ErrorGlyphs) -> None:
    """The true position of one instance, or the number of combined ones."""
    for (column, row), size in zip(
        glyph_set.centres.tolist(), glyph_set.counts.tolist(), strict=True
    ):
        glyph = canvas.glyphs.truth if size == 1 else str(size) if size < 10 else "+"
        canvas.put(int(column), int(row), glyph, canvas.theme.truth, bold=True)


def _arcs(canvas: Canvas, glyph_set: ErrorGlyphs, y_down: bool) -> None:
    sim, real = (_ring(canvas, glyph_set, part, y_down) for part in (glyph_set.sim, glyph_set.real))
    theme = canvas.theme
    counts = [
        part.reshape(canvas.height, 4, canvas.width, 2).sum(axis=(1, 3))
        for part in (sim, real, sim & real)
    ]
    colours = np.empty((canvas.height, canvas.width, 3), dtype=np.uint8)
    colours[:] = theme.sim
    colours[counts[1] > counts[0]] = theme.real
    colours[counts[2] > 0] = theme.both
    draw_braille(canvas, sim | real, colours)
    _tips(canvas, glyph_set, y_down)


def _ring(
    canvas: Canvas, glyph_set: ErrorGlyphs, vectors: NDArray[np.float64], y_down: bool
) -> Grid:
    """The arcs of one side as braille dots (4 rows, 2 columns per cell)."""
    half = np.radians(arc_degrees(vectors, glyph_set.full))[:, None] / 2
    angles = arc_turns(vectors, y_down)[:, None] + half * np.linspace(-1, 1, 32)
    angles, radii = angles[..., None], np.array(RADII)
    middle = np.floor(glyph_set.centres)[:, None, None] + 0.5
    columns = middle[..., 0] + radii / 2 * np.cos(angles)
    rows = middle[..., 1] + radii / 4 * np.sin(angles)
    known = np.isfinite(columns)
    return dot_grid(columns[known], rows[known], canvas.width, canvas.height)


def _tips(canvas: Canvas, glyph_set: ErrorGlyphs, y_down: bool) -> None:
    """The side's glyph in the middle of each arc, one for both where they coincide."""
    places = [_tip_cells(glyph_set, part, y_down) for part in (glyph_set.sim, glyph_set.real)]
    for sim, real in zip(*(part.tolist() for part in places), strict=True):
        tips = [(sim, "both")] if sim == real else [(sim, "sim"), (real, "real")]
        for place, role in tips:
            glyph, colour = canvas.options.role(role)
            canvas.put(place[0], place[1], glyph, colour, bold=True)


def _tip_cells(
    glyph_set: ErrorGlyphs, vectors: NDArray[np.float64], y_down: bool
) -> NDArray[np.intp]:
    turns = arc_turns(vectors, y_down)
    middle = np.floor(glyph_set.centres) + 0.5
    step = np.stack([np.cos(turns) * RADII[-1] / 2, np.sin(turns) * RADII[-1] / 4], axis=1)
    return np.where(np.isfinite(step), np.floor(middle + step), -1).astype(np.intp)


def _arrows(canvas: Canvas, glyph_set: ErrorGlyphs, y_down: bool) -> None:
    """An arrow in the error's direction, with the side's letter and the size of the error."""
    sim, real = (_octants(part, y_down) for part in (glyph_set.sim, glyph_set.real))
    sizes = [_digits(part, glyph_set.full) for part in (glyph_set.sim, glyph_set.real)]
    middles = np.floor(glyph_set.centres).astype(int).tolist()
    for index, (column, row) in enumerate(middles):
        texts = [side[index] for side in sizes]
        if sim[index] == real[index]:
            _arrow(canvas, column, row, sim[index], None, "".join(texts), "both")
            continue
        _arrow(canvas, column, row, sim[index], real[index], texts[0], "sim")
        _arrow(canvas, column, row, real[index], sim[index], texts[1], "real")


def _arrow(
    canvas: Canvas, column: int, row: int, octant: int, other: int | None, size: str, role: str
) -> None:
    """One arrow; a label above or below the point avoids the other arrow."""
    if octant < 0:
        return
    glyph, colour = canvas.options.role(role)
    label = glyph + size
    across, down = OCTANTS[octant]
    leftwards = across < 0
    if across == 0 and other is not None and other >= 0:
        leftwards = OCTANTS[other] == (1, down)
    canvas.put(column + across, row + down, canvas.glyphs.arrows[octant], colour, bold=True)
    start = column + across + (-len(label) if leftwards else 1)
    canvas.text(start, row + down, label, colour, bold=True)


def _octants(vectors: NDArray[np.float64], y_down: bool) -> list[int]:
    """The eighth of a turn, clockwise on the screen from the right; -1 where unknown."""
    turns = arc_turns(vectors, y_down)
    known = np.isfinite(turns)
    eighths = np.rint(np.where(known, turns, 0) / (np.pi / 4)).astype(int) % 8
    return list(np.where(known, eighths, -1).tolist())


def _digits(vectors: NDArray[np.float64], full: float) -> list[str]:
    """The size of each error in ninths of full scale."""
    share = np.minimum(np.hypot(vectors[:, 0], vectors[:, 1]) / full, 1.0)
    return [str(round(9 * part)) for part in np.nan_to_num(share).tolist()]


def glyph_legend(
    data: MapInput, model: MapModel, options: RenderOptions, width: int
) -> list[LegendPart]:
    """The legend of arcs or arrows."""
    full = f"{short_number(full_scale(data), 2)} m"
    largest = f"{LARGEST:g}{options.glyphs.degree}" if options.supports_images else "9"
    parts = [role_legend(options, sim="sim", real="real", both=f"both  {largest} = {full}")]
    if model.highlighted > 1:
        theme = options.theme
        parts.append(text_part((("2..9 + ", theme.truth), ("mean of n instances", theme.muted))))
    return parts


DRAWINGS = {"colour": draw_values, "glyph": draw_error_glyphs, "full": draw_predictions}
LEGENDS = {"colour": value_legend, "glyph": glyph_legend, "full": full_legend}
"""How the selected are drawn and explained in the legend, per map mode."""
