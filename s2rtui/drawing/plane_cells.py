"""Draw the marks of a plane in character cells, and what a legend says of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len

from s2rstore.records import Room
from s2rtui.analysis.binning import Bools, count_selected, selection_indices
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.canvas import Canvas, RenderOptions, Rgb, heading_arrow, legible
from s2rtui.canvas.fit_text import fit_text
from s2rtui.canvas.raster import braille_bits, draw_braille, put_glyphs, segment_dots
from s2rtui.drawing.arcs import arcs_legend, draw_arcs
from s2rtui.drawing.floor import draw_floor, draw_outlines, plane_frame
from s2rtui.drawing.heat_colours import change_colours, ramp_glyphs
from s2rtui.drawing.legend import (
    LegendPart,
    point_colours,
    scale_bar,
    text_part,
)
from s2rtui.drawing.plane_marks import (
    Arcs,
    Changes,
    Floor,
    Outlines,
    PlaneMark,
    Poses,
    ScaleBar,
    Segments,
    Signs,
    Unselected,
)
from s2rtui.drawing.plot import Plot
from s2rtui.drawing.points import (
    canvas_grid,
    change_cells,
    change_signs,
    dot_bins,
    drawn_segments,
    selected_count,
    sign_cells,
)
from s2rtui.drawing.trained_marks import SEVERAL as SEVERAL_TRAINED
from s2rtui.drawing.trained_marks import (
    TrainedForms,
    digit_forms,
    glyph_forms,
    mark_trained,
    trained_legend,
)

SEGMENTS_UP_TO = 24
"""Up to this number of selected instances, in view or in all, segments are drawn."""
_SEVERAL = {"sim": "■", "real": "□", "truth": "●", "selected": "■"}
"""The glyph of each sign where a cell has several instances."""
_CHANGES, _ONE = "▼●▲", "▾•▴"
"""Changes below 0, within the margin and above 0 of several instances, and of one."""
_OUTLINED = "▽○△", "▿◦▵"
"""The same for cells with trained instances."""
_RINGED, _LETTERS = "⊖⊜⊕", "bea"
"""The same without colours, and in ASCII."""
_UNSELECTED, _SELECTED, _CURSOR = 1, 20, 1000
"""Costs of a name in a cell with unselected points, with a selected mark, with the cursor."""
_FEWEST_LETTERS = 3
"""Letters of a cut name at least."""


def draw_names(canvas: Canvas, plot: Plot, before: Canvas) -> Bools:
    """Write the names of rooms over the marks; `before` is the canvas with its ground alone.

    Returns the cells (h, w) that they take.
    """
    bare = canvas.char.copy()
    frame = plane_frame(plot.x, plot.y, canvas.width, canvas.height)
    for mark in plot.marks:
        if isinstance(mark, Outlines):
            draw_room_names(canvas, mark.rooms, frame, mark_costs(before, canvas))
    return np.asarray(canvas.char != bare)


def plane_legend(
    mark: PlaneMark, plot: Plot, options: RenderOptions, room: int, pitch: float
) -> list[LegendPart]:
    """What a mark shows, in parts of about `room` cells, which are `pitch` units of x wide."""
    explain = _LEGENDS.get(type(mark))
    if isinstance(mark, ScaleBar):
        return [scale_bar(pitch, max(4, room // 6), options)]
    return explain(mark, options) if explain is not None else []


def _draw_dots(canvas: Canvas, grid: Bools, colour: Rgb, glyph: str) -> None:
    """Braille dots (4 rows, 2 columns per cell); in ASCII a glyph per cell."""
    if not canvas.options.ascii:
        draw_braille(canvas, grid, colour)
        return
    rows, columns = np.nonzero(braille_bits(grid))
    put_glyphs(canvas, columns, rows, glyph, colour, bold=False)


def _draw_unselected(canvas: Canvas, plot: Plot, mark: Unselected) -> None:
    dots = dot_bins(mark.x, mark.y, canvas_grid(canvas, plot))
    part, total = count_selected(dots, selection_indices(mark.selected, mark.valid))
    grid = (total > part).reshape(4 * canvas.height, 2 * canvas.width)
    _draw_dots(canvas, grid, canvas.theme.unselected, canvas.glyphs.unselected)


def _draw_signs(canvas: Canvas, plot: Plot, signs: Signs) -> None:
    """A sign per cell; without colours digits show values, and cells of several are bold."""
    cells, options = sign_cells(signs, canvas_grid(canvas, plot)), canvas.options
    columns, rows, many = cells.columns, cells.rows, cells.counts > 1
    digits = ramp_glyphs("values", options)
    one = getattr(options.glyphs, signs.sign)
    colours = np.tile(np.array(getattr(canvas.theme, signs.ink), dtype=np.uint8), (len(rows), 1))
    known = np.isfinite(cells.values)
    glyphs = np.full(len(rows), one)
    if digits is None:
        glyphs[many] = _SEVERAL.get(signs.sign, one)
    elif signs.values is not None:
        steps = np.clip(np.nan_to_num(cells.values) * len(digits), 0, len(digits) - 1)
        glyphs = np.where(known, np.array(list(digits))[steps.astype(np.intp)], "?")
    if signs.values is not None:
        colours[known] = point_colours(canvas.theme)(cells.values[known])
    put_glyphs(canvas, columns, rows, glyphs, colours, many if digits is not None else True)
    mark_trained(canvas, (rows[cells.trained], columns[cells.trained]), _sign_forms(signs, options))


def _sign_forms(signs: Signs, options: RenderOptions) -> TrainedForms:
    """The forms of the glyphs of cells with trained instances."""
    one, mark = getattr(options.glyphs, signs.sign), options.glyphs.trained
    if ramp_glyphs("values", options) is not None:
        return glyph_forms(one, mark) if signs.values is None else digit_forms(options)
    several = _SEVERAL.get(signs.sign, one)
    return glyph_forms(one + several, mark + SEVERAL_TRAINED, f"{mark} {SEVERAL_TRAINED}")


def _several_part(options: RenderOptions, glyphs: str) -> LegendPart:
    """The part that explains cells with several instances, which have `glyphs`."""
    theme = options.theme
    if ramp_glyphs("values", options) is not None:
        return text_part((("bold: several", theme.muted),))
    return text_part(((f"{glyphs} ", theme.text), ("several", theme.muted)))


def _signs_legend(signs: Signs, options: RenderOptions) -> list[LegendPart]:
    parts = []
    if signs.sign in ("selected", "truth") and selected_count(signs.selected, signs.valid) > 1:
        glyphs = "■ □ ●" if signs.sign == "truth" else options.glyphs.several
        parts.append(_several_part(options, glyphs))
    if signs.trained is not None:
        parts.append(trained_legend(options, _sign_forms(signs, options)))
    return parts


def change_glyphs(options: RenderOptions) -> str:
    """Three glyphs: a change below 0, one within the margin, one above 0."""
    return ramp_glyphs("changes", options) or _CHANGES


def _draw_changes(canvas: Canvas, plot: Plot, changes: Changes) -> None:
    """A glyph per cell in the colour of its mean, larger or bold for several instances."""
    cells, glyphs = change_cells(changes, canvas_grid(canvas, plot)), change_glyphs(canvas.options)
    one = _ONE if glyphs == _CHANGES else glyphs
    sign, many = change_signs(cells.values, changes.margin) + 1, cells.counts > 1
    shown = np.where(many, np.array(list(glyphs))[sign], np.array(list(one))[sign])
    colours = legible(change_colours(cells.values / changes.scale), canvas.theme)
    put_glyphs(canvas, cells.columns, cells.rows, shown, colours, many)
    held = cells.trained
    mark_trained(canvas, (cells.rows[held], cells.columns[held]), _change_forms(canvas.options))


def _change_forms(options: RenderOptions) -> TrainedForms:
    glyphs = change_glyphs(options)
    if glyphs == _CHANGES:
        return glyph_forms(_CHANGES + _ONE, "".join(_OUTLINED), _OUTLINED[0])
    if options.ascii:
        return glyph_forms(glyphs, _LETTERS, f"{_LETTERS} (for {glyphs})")
    return glyph_forms(glyphs, _RINGED)


def _changes_legend(changes: Changes, options: RenderOptions) -> list[LegendPart]:
    theme, pieces = options.theme, list[tuple[str, Rgb]]()
    ends = legible(change_colours([-1.0, 0.0, 1.0]), theme).tolist()
    for glyph, (red, green, blue), text in zip(
        change_glyphs(options), ends, changes.texts, strict=True
    ):
        pieces += [(f"{glyph} ", (red, green, blue)), (f"{options.printable(text)}  ", theme.text)]
    parts = [text_part(pieces)]
    if selected_count(changes.selected, changes.valid) > 1:
        parts.append(_several_part(options, _CHANGES))
    if changes.trained is not None:
        parts.append(trained_legend(options, _change_forms(options)))
    return parts


def _draw_segments(canvas: Canvas, plot: Plot, segments: Segments) -> None:
    """Lines in braille or in full stops."""
    grid = canvas_grid(canvas, plot)
    ids = drawn_segments(segments, grid, SEGMENTS_UP_TO)
    ends = [grid.places(x[ids], y[ids]) for x, y in (segments.start, segments.end)]
    lines = np.stack(ends, axis=1)
    known = lines[np.isfinite(lines).all(axis=(1, 2))].tolist()
    dots = segment_dots(known, grid.width, grid.height)
    _draw_dots(canvas, dots, getattr(canvas.theme, segments.ink), ".")


def _segments_legend(segments: Segments, options: RenderOptions) -> list[LegendPart]:
    if selected_count(segments.selected, segments.valid) <= SEGMENTS_UP_TO:
        return []
    return [text_part(((f"error lines for up to {SEGMENTS_UP_TO}", options.theme.muted),))]


def _draw_poses(canvas: Canvas, plot: Plot, poses: Poses) -> None:
    """The sign and, beside it, the arrow of each pose, or the arrows alone; the first on top."""
    grid, colour = canvas_grid(canvas, plot), getattr(canvas.theme, poses.ink)
    for x, y, heading in reversed(poses.places):
        (place,) = grid.places(np.array([x]), np.array([y]))
        if not ((place >= 0) & (place < (grid.width, grid.height))).all():
            continue
        column, row = place.astype(int).tolist()
        if poses.sign is not None:
            canvas.put(column, row, getattr(canvas.glyphs, poses.sign), colour, bold=True)
        if heading is not None:
            arrow, right, down = heading_arrow(heading, plot.y_down, canvas.glyphs)
            beside = (right, down) if poses.sign is not None else (0, 0)
            canvas.put(column + beside[0], row + beside[1], arrow, colour, bold=True)


def _floor_legend(floor: Floor, options: RenderOptions) -> list[LegendPart]:
    if floor.seen is None or floor.is_plain:
        return []
    how = "dim" if options.supports_shading else "blank"
    return [text_part(((f"{how}: not seen", options.theme.muted),))]


def _unselected_legend(mark: Unselected, options: RenderOptions) -> list[LegendPart]:
    if selected_count(mark.selected, mark.valid) == selected_count(mark.valid, mark.valid):
        return []
    grey, theme = options.glyphs.unselected if options.ascii else "⠿", options.theme
    return [text_part(((f"{grey} ", theme.unselected), ("not selected", theme.muted)))]


PLANE_DRAWINGS: dict[type, Callable[[Canvas, Plot, Any], None]] = {
    Floor: draw_floor, Outlines: draw_outlines, Unselected: _draw_unselected, Signs: _draw_signs,
    Changes: _draw_changes, Segments: _draw_segments, Arcs: draw_arcs, Poses: _draw_poses,
}  # fmt: skip
_LEGENDS: dict[type, Callable[[Any, RenderOptions], list[LegendPart]]] = {
    Floor: _floor_legend, Unselected: _unselected_legend, Signs: _signs_legend,
    Changes: _changes_legend, Segments: _segments_legend, Arcs: arcs_legend,
}  # fmt: skip


def mark_costs(before: Canvas, canvas: Canvas) -> NDArray[np.intp]:
    """What a name costs in each cell (h, w); `before` is the canvas without selected marks."""
    braille = (before.char >= "\u2801") & (before.char <= "\u28ff")
    dots = braille | (before.char == canvas.glyphs.unselected)
    costs = np.where(dots, _UNSELECTED, 0)
    marked = (canvas.char != before.char) | (canvas.fg != before.fg).any(axis=-1)
    costs[marked] = _SELECTED
    costs[canvas.char == canvas.glyphs.cursor] = _CURSOR
    return costs.astype(np.intp)


def draw_room_names(
    canvas: Canvas, rooms: Sequence[Room], frame: MapFrame, costs: NDArray[np.intp]
) -> None:
    """Write each room's name once, on page colour and in front of points.

    Of all places in the room, the one of least cost (h, w) is taken that is nearest to its middle.
    A name that is wider than its room is cut, or left out where less than `_FEWEST_LETTERS` fit.
    """
    costs, named = costs.copy(), set[str]()
    for room in rooms:
        if room.room in named:
            continue
        named.add(room.room)
        corners = frame.to_cells([[room.x0, room.y0], [room.x1, room.y1]])
        first, last = corners.min(axis=0), corners.max(axis=0)
        wide = min(canvas.width, int(last[0])) - max(0, int(np.ceil(first[0])))
        whole, ellipsis = canvas.options.printable(room.room), canvas.glyphs.ellipsis
        name = fit_text(whole, wide, ellipsis)
        place = _place(costs, first, last, cell_len(name))
        if place is not None and (name == whole or cell_len(name) > _FEWEST_LETTERS):
            column, row = place
            canvas.text(column, row, name, canvas.theme.muted, canvas.theme.background)
            costs[row, column : column + cell_len(name)] = _CURSOR


def _place(
    costs: NDArray[np.intp], first: NDArray[np.float64], last: NDArray[np.float64], length: int
) -> tuple[int, int] | None:
    """The best column and row for `length` cells between two corners in cells, if they fit."""
    height, width = costs.shape
    left, top = (max(0, int(np.ceil(part))) for part in first)
    right, bottom = min(width, int(last[0])), min(height, int(last[1]))
    if length < 1 or right - left < length or bottom <= top:
        return None
    sums = np.cumsum(np.pad(costs[top:bottom, left:right], ((0, 0), (1, 0))), axis=1)
    covered = sums[:, length:] - sums[:, :-length]
    middle = (first + last) / 2
    rows = np.arange(top, bottom) + 0.5 - middle[1]
    columns = np.arange(left, right - length + 1) + length / 2 - middle[0]
    distance = 2 * np.abs(rows)[:, None] + np.abs(columns)
    order = np.lexsort((distance.ravel(), covered.ravel()))
    row, column = divmod(int(order[0]), covered.shape[1])
    return left + column, top + row
