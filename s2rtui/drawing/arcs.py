"""Errors as arcs around instances: near ones in common, how wide and where an arc is, and in cells.

Where there are no colours, arrows take the place of arcs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import (
    Bins,
    Bools,
    SelectionIndices,
    count_selected,
    selection_indices,
    sum_selected,
)
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import Canvas, RenderOptions, mix
from s2rtui.canvas.raster import dot_grid, draw_braille, put_glyphs
from s2rtui.drawing.legend import LegendPart, role_legend, text_part
from s2rtui.drawing.plane_marks import Arcs, Columns, Signs
from s2rtui.drawing.plot import Plot
from s2rtui.drawing.points import (
    Grid,
    canvas_grid,
    cell_bins,
    selected_count,
    selected_in_view,
    sign_cells,
)
from s2rtui.drawing.scale import Floats, short_number
from s2rtui.drawing.trained_marks import (
    TrainedForms,
    mark_trained,
    number_forms,
    number_glyphs,
    trained_legend,
)

SINGLES = 200
"""Above this number of visible selected instances, glyphs stand for blocks of cells."""
SMALLEST, LARGEST = 20.0, 180.0
"""Degrees of an arc of the smallest error, and of one of full scale."""
Vectors = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ErrorGlyphs:
    """k glyphs. centres: (k, 2) columns and rows of cells; counts: (k,) instances of each.

    sim, real: (k, 2) mean errors along x and y, NaN where unknown. trained: (k,) whether a
    trained instance is among them.
    """

    centres: Vectors
    counts: NDArray[np.intp]
    sim: Vectors
    real: Vectors
    trained: Bools

    @property
    def is_crowded(self) -> bool:
        """Whether glyphs stand for blocks of cells."""
        return int(self.counts.sum()) > SINGLES


@cached_by_identity(4)
def error_glyphs(arcs: Arcs, grid: Grid, footprint: tuple[int, int]) -> ErrorGlyphs:
    """The glyphs of the selected instances in view, each on `footprint` cells (wide, high).

    Up to `SINGLES` instances have a glyph at their place, near ones a common glyph at their mean;
    more are combined by blocks of footprint size.
    """
    selection = selection_indices(arcs.selected, arcs.valid)
    ids = selected_in_view(arcs.x, arcs.y, selection, grid, SINGLES)
    if ids is None:
        return _blocks(arcs, selection, grid, footprint)
    places = grid.places(arcs.x[ids], arcs.y[ids])
    group = _clusters(places, footprint)
    number = int(group.max(initial=-1)) + 1

    def mean(vectors: Floats) -> Vectors:
        known = np.isfinite(vectors).all(axis=1)
        sizes = np.bincount(group[known], minlength=number)
        axes = [np.bincount(group[known], part[known], minlength=number) for part in vectors.T]
        with np.errstate(invalid="ignore"):
            return np.stack(axes, axis=1) / np.where(sizes > 0, sizes, np.nan)[:, None]

    held = np.zeros(number, dtype=np.bool_)
    if arcs.trained is not None:
        held[group[arcs.trained[ids]]] = True
    sides = arcs.sim, arcs.real
    errors = [mean(np.stack([part[ids] for part in side], axis=1)) for side in sides]
    sizes = np.bincount(group, minlength=number)
    return ErrorGlyphs(mean(places), sizes, errors[0], errors[1], held)


def _clusters(places: Vectors, footprint: tuple[int, int]) -> NDArray[np.intp]:
    """The group of each place (n, 2): one that lies within a footprint of an earlier one."""
    group = np.full(len(places), -1, dtype=np.intp)
    number = 0
    for index in range(len(places)):
        if group[index] < 0:
            near = (np.abs(places - places[index]) < footprint).all(axis=1)
            group[near & (group < 0)] = number
            number += 1
    return group


def _blocks(
    arcs: Arcs, selection: SelectionIndices, grid: Grid, footprint: tuple[int, int]
) -> ErrorGlyphs:
    """One glyph in the middle of each block of cells with a selected instance."""
    wide, high = footprint
    across = -(-grid.width // wide)
    column = _block_codes(arcs.x, arcs.y, arcs.sim, arcs.real, grid, footprint)
    counts, _ = count_selected(column, selection)
    held = np.flatnonzero(counts)
    middles = np.stack([held % across * wide + wide / 2, held // across * high + high / 2], axis=1)

    def mean(side: Columns) -> Vectors:
        parts = [sum_selected(column, part, selection)[held] for part in side]
        return np.stack(parts, axis=1) / counts[held, None]

    marked = np.zeros(len(held), dtype=np.bool_)
    if arcs.trained is not None:
        members = selection.members
        marked = np.isin(held, column.codes[members[arcs.trained[members]]])
    return ErrorGlyphs(middles, counts[held], mean(arcs.sim), mean(arcs.real), marked)


@cached_by_identity(4)
def _block_codes(
    x: Floats, y: Floats, sim: Columns, real: Columns, grid: Grid, footprint: tuple[int, int]
) -> Bins:
    """The block of each instance with known errors, as bins."""
    (wide, high), width, height = footprint, grid.width, grid.height
    count = -(-width // wide) * -(-height // high)
    rows, columns = np.divmod(np.arange(height * width), width)
    table = np.append(rows // high * -(-width // wide) + columns // wide, count)
    codes = table.astype(np.uint16)[cell_bins(x, y, grid).codes]
    for part in (*sim, *real):
        codes[~np.isfinite(part)] = count
    return Bins(codes, count)


def arc_degrees(vectors: Vectors, full: float) -> Floats:
    """The width of the arc of each error (k, 2) in degrees; NaN where unknown."""
    share = np.minimum(np.hypot(vectors[:, 0], vectors[:, 1]) / full, 1.0)
    return np.maximum(SMALLEST, LARGEST * share)


def arc_turns(vectors: Vectors, y_down: bool) -> Floats:
    """The direction of each error on the screen: radians clockwise from the right."""
    return np.arctan2(vectors[:, 1] * (1 if y_down else -1), vectors[:, 0])


Spans = tuple[Floats, Floats]
"""First and last angle (k,) of arcs in degrees of the plane; NaN where unknown."""


def arc_spans(vectors: Vectors, full: float) -> Spans:
    """The arcs of errors (k, 2)."""
    middle, half = np.degrees(np.arctan2(vectors[:, 1], vectors[:, 0])), arc_degrees(vectors, full)
    return middle - half / 2, middle + half / 2


def arc_overlap(first: Spans, second: Spans) -> Spans:
    """The overlap of arcs of at most 180 degrees; the end is not above the start without one."""
    turn = 360 * np.rint((first[0] + first[1] - second[0] - second[1]) / 720)
    return np.maximum(first[0], second[0] + turn), np.minimum(first[1], second[1] + turn)


ARC_FOOTPRINT, ARROW_FOOTPRINT = (7, 3), (9, 3)
"""Columns and rows of cells that an error takes as arcs, and as arrows."""
_RADII = (3.0, 3.6, 4.2)
"""Radii of the arcs in braille dots, which makes them two dots thick."""
_OCTANTS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
"""Columns and rows from the point to its arrow, in the order of `Glyphs.arrows`."""


def draw_arcs(canvas: Canvas, plot: Plot, arcs: Arcs) -> None:
    """Draw errors as braille arcs, or, where there are no colours, as arrows with letters."""
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
    parts = [role_legend(options, truth="truth", sim="sim", real="real", both=full)]
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
