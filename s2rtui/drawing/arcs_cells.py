"""Draw errors of both sides in character cells: arcs, or arrows where there are no colours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import Bools
from s2rtui.canvas import Canvas, RenderOptions, mix
from s2rtui.canvas.raster import dot_grid, draw_braille, put_glyphs
from s2rtui.drawing.arcs import LARGEST, ErrorGlyphs, arc_degrees, arc_turns, error_glyphs
from s2rtui.drawing.legend import LegendPart, role_legend, text_part
from s2rtui.drawing.plane_marks import Arcs, Signs
from s2rtui.drawing.plot import Plot
from s2rtui.drawing.points import canvas_grid, selected_count, sign_cells
from s2rtui.drawing.scale import short_number
from s2rtui.drawing.trained_marks import (
    TrainedForms,
    mark_trained,
    number_forms,
    number_glyphs,
    trained_legend,
)

ARC_FOOTPRINT, ARROW_FOOTPRINT = (7, 3), (9, 3)
"""Columns and rows of cells that an error takes as arcs, and as arrows."""
_RADII = (3.0, 3.6, 4.2)
"""Radii of the arcs in braille dots, which makes them two dots thick."""
_OCTANTS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
"""Columns and rows from the point to its arrow, in the order of `Glyphs.arrows`."""


def draw_arcs(canvas: Canvas, plot: Plot, arcs: Arcs) -> None:
    """Errors as arcs in braille, or as arrows with letters and sizes without colours."""
    options = canvas.options
    footprint = ARC_FOOTPRINT if options.supports_images else ARROW_FOOTPRINT
    glyphs = error_glyphs(arcs, canvas_grid(canvas, plot), footprint)
    dots = Signs(arcs.x, arcs.y, arcs.selected, arcs.valid, trained=arcs.trained)
    cells = sign_cells(dots, canvas_grid(canvas, plot))
    glyph, colour = options.glyphs.truth, np.array(canvas.theme.truth)
    if glyphs.is_crowded:
        glyph = "." if options.ascii else "·"
        colour = mix(canvas.theme.background, colour, 0.55)
    marked = np.where(cells.trained, options.glyphs.trained, glyph)
    put_glyphs(canvas, cells.columns, cells.rows, marked, colour, bold=False)
    draw = _draw_rings if options.supports_images else _draw_arrows
    draw(canvas, glyphs, arcs.full, plot.y_down)
    columns, rows, held = _middles(canvas, glyphs)
    put_glyphs(canvas, columns, rows, number_glyphs(glyphs.counts[held], options.glyphs.truth),
         canvas.theme.truth)  # fmt: skip
    marked = glyphs.trained[held]
    mark_trained(canvas, (rows[marked], columns[marked]), _arc_forms(options))


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
        glyphs = error_glyphs(arcs, canvas_grid(canvas, plot), ARC_FOOTPRINT)
        columns, rows, held = _middles(canvas, glyphs)
        is_number = canvas.char[rows, columns] != canvas.glyphs.cursor
        cells[rows, columns] = (glyphs.counts[held] > 1) & is_number
    return cells


def _arc_forms(options: RenderOptions) -> TrainedForms:
    return number_forms(options, options.glyphs.truth)


def arcs_legend(arcs: Arcs, options: RenderOptions) -> list[LegendPart]:
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
