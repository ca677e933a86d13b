"""Draw the marks of a plane in character cells, and what a legend says of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import Bools, count_selected, selection_indices
from s2rtui.canvas import Canvas, RenderOptions, Rgb, heading_arrow, legible, mix
from s2rtui.canvas.raster import braille_bits, dot_grid, draw_braille, line_dots
from s2rtui.drawing.arcs import LARGEST, ErrorGlyphs, arc_degrees, arc_turns, error_glyphs
from s2rtui.drawing.floor import plane_frame
from s2rtui.drawing.floor_cells import draw_floor, draw_outlines
from s2rtui.drawing.heat_colours import change_colours
from s2rtui.drawing.legend import (
    LegendPart,
    point_colours,
    ramp_for_values,
    role_legend,
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
from s2rtui.drawing.points import dot_bins
from s2rtui.drawing.room_names import draw_room_names, mark_costs
from s2rtui.drawing.scale import short_number
from s2rtui.drawing.signs import (
    Grid,
    change_cells,
    change_signs,
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
    number_forms,
    number_glyphs,
    trained_legend,
)

SEGMENTS_UP_TO = 24
"""Up to this number of selected instances, in view or in all, segments are drawn."""
ARC_FOOTPRINT, ARROW_FOOTPRINT = (7, 3), (9, 3)
"""Columns and rows of cells that an error takes as arcs, and as arrows."""
_RADII = (3.0, 3.6, 4.2)
"""Radii of the arcs in braille dots, which makes them two dots thick."""
_OCTANTS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
"""Columns and rows from the point to its arrow, in the order of `Glyphs.arrows`."""
_SEVERAL = {"sim": "■", "real": "□", "truth": "●", "selected": "■"}
"""The glyph of each sign where a cell has several instances."""
_CHANGES, _ONE = "▼●▲", "▾•▴"
"""Changes below 0, within the margin and above 0 of several instances, and of one."""
_OUTLINED = "▽○△", "▿◦▵"
"""The same for cells with trained instances."""
_RINGED, _LETTERS = "⊖⊜⊕", "bea"
"""The same without colours, and in ASCII."""


def draw_plane_mark(canvas: Canvas, plot: Plot, mark: PlaneMark) -> None:
    """Draw a mark of a plane on the whole canvas."""
    if (draw := _DRAWINGS.get(type(mark))) is not None:
        draw(canvas, plot, mark)


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


def _grid(canvas: Canvas, plot: Plot) -> Grid:
    return plot.x, plot.y, canvas.width, canvas.height


def _y_down(plot: Plot) -> bool:
    return plot.y.low > plot.y.high


def _put(
    canvas: Canvas, columns: NDArray[np.intp], rows: NDArray[np.intp], glyphs: Any, colours: Any,
    bold: Any = True,
) -> None:  # fmt: skip
    canvas.char[rows, columns] = glyphs
    canvas.bold[rows, columns] = bold
    canvas.fg[rows, columns] = colours


def _draw_dots(canvas: Canvas, grid: Bools, colour: Rgb, glyph: str) -> None:
    """Braille dots (4 rows, 2 columns per cell); in ASCII a glyph per cell."""
    if not canvas.options.ascii:
        draw_braille(canvas, grid, colour)
        return
    rows, columns = np.nonzero(braille_bits(grid))
    _put(canvas, columns, rows, glyph, colour, bold=False)


def _draw_unselected(canvas: Canvas, plot: Plot, mark: Unselected) -> None:
    dots = dot_bins(mark.x, mark.y, *_grid(canvas, plot))
    part, total = count_selected(dots, selection_indices(mark.selected, mark.valid))
    grid = (total > part).reshape(4 * canvas.height, 2 * canvas.width)
    _draw_dots(canvas, grid, canvas.theme.unselected, canvas.glyphs.unselected)


def _draw_signs(canvas: Canvas, plot: Plot, signs: Signs) -> None:
    """A sign per cell; without colours digits show values, and cells of several are bold."""
    cells, options = sign_cells(signs, _grid(canvas, plot)), canvas.options
    columns, rows, many = cells.columns, cells.rows, cells.counts > 1
    digits = ramp_for_values(options)
    one = getattr(options.glyphs, signs.sign)
    colours = np.tile(np.array(getattr(canvas.theme, signs.ink), dtype=np.uint8), (len(rows), 1))
    known = np.isfinite(cells.shares)
    glyphs = np.full(len(rows), one)
    if digits is None:
        glyphs[many] = _SEVERAL.get(signs.sign, one)
    elif signs.values is not None:
        steps = np.clip(np.nan_to_num(cells.shares) * len(digits), 0, len(digits) - 1)
        glyphs = np.where(known, np.array(list(digits))[steps.astype(np.intp)], "?")
    if signs.values is not None:
        colours[known] = point_colours(canvas.theme)(cells.shares[known])
    _put(canvas, columns, rows, glyphs, colours, many if digits is not None else True)
    _mark_trained(canvas, columns[cells.trained], rows[cells.trained], _sign_forms(signs, options))


def _mark_trained(
    canvas: Canvas, columns: NDArray[np.intp], rows: NDArray[np.intp], forms: TrainedForms
) -> None:
    held = np.zeros(canvas.char.shape, dtype=np.bool_)
    held[rows, columns] = True
    mark_trained(canvas, held, forms)


def _sign_forms(signs: Signs, options: RenderOptions) -> TrainedForms:
    """The forms of the glyphs of cells with trained instances."""
    one, mark = getattr(options.glyphs, signs.sign), options.glyphs.trained
    if ramp_for_values(options) is not None:
        return glyph_forms(one, mark) if signs.values is None else digit_forms(options)
    several = _SEVERAL.get(signs.sign, one)
    return glyph_forms(one + several, mark + SEVERAL_TRAINED, f"{mark} {SEVERAL_TRAINED}")


def several_part(options: RenderOptions, glyphs: str) -> LegendPart:
    """The part that explains cells with several instances, which have `glyphs`."""
    theme = options.theme
    if ramp_for_values(options) is not None:
        return text_part((("bold: several", theme.muted),))
    return text_part(((f"{glyphs} ", theme.text), ("several", theme.muted)))


def _signs_legend(signs: Signs, options: RenderOptions) -> list[LegendPart]:
    parts = []
    if signs.sign in ("selected", "truth") and selected_count(signs.selected, signs.valid) > 1:
        glyphs = "■ □ ●" if signs.sign == "truth" else options.glyphs.several
        parts.append(several_part(options, glyphs))
    if signs.trained is not None:
        parts.append(trained_legend(options, _sign_forms(signs, options)))
    return parts


def change_glyphs(options: RenderOptions) -> str:
    """Three glyphs: a change below 0, one within the margin, one above 0."""
    return "-=+" if ramp_for_values(options) is not None else _CHANGES


def _draw_changes(canvas: Canvas, plot: Plot, changes: Changes) -> None:
    """A glyph per cell in the colour of its mean, larger or bold for several instances."""
    cells, glyphs = change_cells(changes, _grid(canvas, plot)), change_glyphs(canvas.options)
    one = _ONE if glyphs == _CHANGES else glyphs
    sign, many = change_signs(cells.means, changes.margin) + 1, cells.counts > 1
    shown = np.where(many, np.array(list(glyphs))[sign], np.array(list(one))[sign])
    colours = legible(change_colours(cells.means / changes.scale), canvas.theme)
    _put(canvas, cells.columns, cells.rows, shown, colours, many)
    held = cells.trained
    _mark_trained(canvas, cells.columns[held], cells.rows[held], _change_forms(canvas.options))


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
        parts.append(several_part(options, _CHANGES))
    if changes.trained is not None:
        parts.append(trained_legend(options, _change_forms(options)))
    return parts


def _draw_segments(canvas: Canvas, plot: Plot, segments: Segments) -> None:
    """Lines in braille or in full stops."""
    ids = drawn_segments(segments, _grid(canvas, plot), SEGMENTS_UP_TO)
    x, y, width, height = _grid(canvas, plot)
    lines = np.stack([
        np.stack([x.fraction(end[0][ids]) * width, (1 - y.fraction(end[1][ids])) * height], axis=1)
        for end in (segments.start, segments.end)
    ], axis=1)  # fmt: skip
    known = lines[np.isfinite(lines).all(axis=(1, 2))].tolist()
    _draw_dots(canvas, line_dots(known, width, height), getattr(canvas.theme, segments.ink), ".")


def _segments_legend(segments: Segments, options: RenderOptions) -> list[LegendPart]:
    if selected_count(segments.selected, segments.valid) <= SEGMENTS_UP_TO:
        return []
    return [text_part(((f"error lines for up to {SEGMENTS_UP_TO}", options.theme.muted),))]


def _draw_poses(canvas: Canvas, plot: Plot, poses: Poses) -> None:
    """The sign and, beside it, the arrow of each pose, or the arrows alone; the first on top."""
    x, y, width, height = _grid(canvas, plot)
    colour = getattr(canvas.theme, poses.ink)
    for across, up, heading in reversed(poses.places):
        place = np.array([float(x.fraction(across)), 1 - float(y.fraction(up))])
        if not ((place >= 0) & (place < 1)).all():
            continue
        column, row = (place * (width, height)).astype(int).tolist()
        if poses.sign is not None:
            canvas.put(column, row, getattr(canvas.glyphs, poses.sign), colour, bold=True)
        if heading is not None:
            arrow, right, down = heading_arrow(heading, _y_down(plot), canvas.glyphs)
            beside = (right, down) if poses.sign is not None else (0, 0)
            canvas.put(column + beside[0], row + beside[1], arrow, colour, bold=True)


def _draw_arcs(canvas: Canvas, plot: Plot, arcs: Arcs) -> None:
    """Errors as arcs in braille, or as arrows with letters and sizes without colours."""
    options = canvas.options
    footprint = ARC_FOOTPRINT if options.supports_images else ARROW_FOOTPRINT
    glyphs = error_glyphs(arcs, _grid(canvas, plot), footprint)
    dots = Signs(arcs.x, arcs.y, arcs.selected, arcs.valid, trained=arcs.trained)
    cells = sign_cells(dots, _grid(canvas, plot))
    glyph, colour = options.glyphs.truth, np.array(canvas.theme.truth)
    if glyphs.is_crowded:
        glyph = "." if options.ascii else "·"
        colour = mix(canvas.theme.background, colour, 0.55)
    marked = np.where(cells.trained, options.glyphs.trained, glyph)
    _put(canvas, cells.columns, cells.rows, marked, colour, bold=False)
    draw = _draw_rings if options.supports_images else _draw_arrows
    draw(canvas, glyphs, arcs.full, _y_down(plot))
    columns, rows, held = _middles(canvas, glyphs)
    _put(canvas, columns, rows, number_glyphs(glyphs.counts[held], options.glyphs.truth),
         canvas.theme.truth)  # fmt: skip
    marked = glyphs.trained[held]
    _mark_trained(canvas, columns[marked], rows[marked], _arc_forms(options))


def _middles(
    canvas: Canvas, glyphs: ErrorGlyphs
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Columns and rows of the middles of glyphs that lie on the canvas, and which these are."""
    columns, rows = np.floor(glyphs.centres).astype(np.intp).T
    held = np.flatnonzero((columns < canvas.width) & (rows < canvas.height))
    return columns[held], rows[held], held


def number_cells(canvas: Canvas, plot: Plot) -> Bools:
    """(h, w) the cells with numbers of arcs, which stay texts in true pixels."""
    cells = np.zeros(canvas.char.shape, dtype=np.bool_)
    for arcs in (mark for mark in plot.marks if isinstance(mark, Arcs)):
        glyphs = error_glyphs(arcs, _grid(canvas, plot), ARC_FOOTPRINT)
        columns, rows, held = _middles(canvas, glyphs)
        is_number = canvas.char[rows, columns] != canvas.glyphs.cursor
        cells[rows, columns] = (glyphs.counts[held] > 1) & is_number
    return cells


def _arc_forms(options: RenderOptions) -> TrainedForms:
    return number_forms(options, options.glyphs.truth)


def _arcs_legend(arcs: Arcs, options: RenderOptions) -> list[LegendPart]:
    largest = f"{LARGEST:g}{options.glyphs.degree}" if options.supports_images else "9"
    full = f"both  {largest} = {short_number(arcs.full, 2)} m"
    parts = [role_legend(options, sim="sim", real="real", both=full)]
    if selected_count(arcs.selected, arcs.valid) > 1:
        theme = options.theme
        parts.append(text_part((("2..9 + ", theme.truth), ("mean of n instances", theme.muted))))
    if arcs.trained is not None:
        parts.append(trained_legend(options, _arc_forms(options)))
    return parts


def _draw_rings(canvas: Canvas, glyphs: ErrorGlyphs, full: float, y_down: bool) -> None:
    sim, real = (_ring(canvas, glyphs, part, full, y_down) for part in (glyphs.sim, glyphs.real))
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
    _draw_tips(canvas, glyphs, y_down)


def _ring(
    canvas: Canvas, glyphs: ErrorGlyphs, vectors: NDArray[np.float64], full: float, y_down: bool
) -> Bools:
    """The arcs of one side as braille dots (4 rows, 2 columns per cell)."""
    half = np.radians(arc_degrees(vectors, full))[:, None] / 2
    angles = arc_turns(vectors, y_down)[:, None] + half * np.linspace(-1, 1, 32)
    angles, radii = angles[..., None], np.array(_RADII)
    middle = np.floor(glyphs.centres)[:, None, None] + 0.5
    columns = middle[..., 0] + radii / 2 * np.cos(angles)
    rows = middle[..., 1] + radii / 4 * np.sin(angles)
    known = np.isfinite(columns)
    return dot_grid(columns[known], rows[known], canvas.width, canvas.height)


def _draw_tips(canvas: Canvas, glyphs: ErrorGlyphs, y_down: bool) -> None:
    """The side's glyph in the middle of each arc, one for both where they coincide."""
    places = [_tip_cells(glyphs, part, y_down) for part in (glyphs.sim, glyphs.real)]
    for sim, real in zip(*(part.tolist() for part in places), strict=True):
        tips = [(sim, "both")] if sim == real else [(sim, "sim"), (real, "real")]
        for place, role in tips:
            glyph, colour = canvas.options.role(role)
            canvas.put(place[0], place[1], glyph, colour, bold=True)


def _tip_cells(glyphs: ErrorGlyphs, vectors: NDArray[np.float64], y_down: bool) -> NDArray[np.intp]:
    turns = arc_turns(vectors, y_down)
    middle = np.floor(glyphs.centres) + 0.5
    step = np.stack([np.cos(turns) * _RADII[-1] / 2, np.sin(turns) * _RADII[-1] / 4], axis=1)
    return np.where(np.isfinite(step), np.floor(middle + step), -1).astype(np.intp)


def _draw_arrows(canvas: Canvas, glyphs: ErrorGlyphs, full: float, y_down: bool) -> None:
    """An arrow in the error's direction, with the side's letter and the size of the error."""
    sim, real = (_octants(part, y_down) for part in (glyphs.sim, glyphs.real))
    sizes = [_digits(part, full) for part in (glyphs.sim, glyphs.real)]
    middles = np.floor(glyphs.centres).astype(int).tolist()
    for index, (column, row) in enumerate(middles):
        texts = [side[index] for side in sizes]
        if sim[index] == real[index]:
            _draw_arrow(canvas, column, row, sim[index], None, "".join(texts), "both")
            continue
        _draw_arrow(canvas, column, row, sim[index], real[index], texts[0], "sim")
        _draw_arrow(canvas, column, row, real[index], sim[index], texts[1], "real")


def _draw_arrow(
    canvas: Canvas, column: int, row: int, octant: int, other: int | None, size: str, role: str
) -> None:
    """One arrow; a label above or below the point avoids the other arrow."""
    if octant < 0:
        return
    glyph, colour = canvas.options.role(role)
    label = glyph + size
    across, down = _OCTANTS[octant]
    leftwards = across < 0
    if across == 0 and other is not None and other >= 0:
        leftwards = _OCTANTS[other] == (1, down)
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


def _floor_legend(floor: Floor, options: RenderOptions) -> list[LegendPart]:
    if floor.seen is None:
        return []
    how = "dim" if options.supports_shading else "blank"
    return [text_part(((f"{how}: not seen", options.theme.muted),))]


def _unselected_legend(mark: Unselected, options: RenderOptions) -> list[LegendPart]:
    if selected_count(mark.selected, mark.valid) == selected_count(mark.valid, mark.valid):
        return []
    grey, theme = options.glyphs.unselected if options.ascii else "⠿", options.theme
    return [text_part(((f"{grey} ", theme.unselected), ("not selected", theme.muted)))]


_DRAWINGS: dict[type, Callable[[Canvas, Plot, Any], None]] = {
    Floor: draw_floor, Outlines: draw_outlines, Unselected: _draw_unselected, Signs: _draw_signs,
    Changes: _draw_changes, Segments: _draw_segments, Arcs: _draw_arcs, Poses: _draw_poses,
}  # fmt: skip
_LEGENDS: dict[type, Callable[[Any, RenderOptions], list[LegendPart]]] = {
    Floor: _floor_legend, Unselected: _unselected_legend, Signs: _signs_legend,
    Changes: _changes_legend, Segments: _segments_legend, Arcs: _arcs_legend,
}  # fmt: skip
