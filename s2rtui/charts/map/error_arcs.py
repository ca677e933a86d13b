"""Mode "glyph" of the geo-map: around each point an arc for the sim and one for the real error."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.map_frame import MapFrame
from s2rtui.canvas.canvas import Canvas
from s2rtui.canvas.colour import Rgb, mix
from s2rtui.canvas.raster import braille, dot_grid
from s2rtui.canvas.render_options import RenderOptions
from s2rtui.charts.map.model import (
    LARGEST,
    ErrorGlyphs,
    arc_degrees,
    arc_turns,
    error_glyphs,
    full_scale,
)
from s2rtui.charts.map.points import stamp
from s2rtui.charts.shared.axis_scale import short
from s2rtui.charts.shared.inputs import GeoMapInput
from s2rtui.charts.shared.legend import LegendPart, words
from s2rtui.charts.shared.map_model import GeoMapModel
from s2rtui.charts.shared.points import lit_cells

ARC_FOOTPRINT = (7, 3)
ARROW_FOOTPRINT = (9, 3)
RADII = (3.0, 3.6, 4.2)
"""Of the arcs, in braille dots: two dots thick."""
OCTANTS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
"""Columns and rows of the eight arrows' places, as `Glyphs.arrows` run."""
Grid = NDArray[np.bool_]


def draw_glyphs(
    canvas: Canvas, view: GeoMapInput, model: GeoMapModel, frame: MapFrame, look: RenderOptions
) -> None:
    """Arcs in braille; arrows with letters and sizes where colours or braille lack."""
    footprint = ARC_FOOTPRINT if look.pictures else ARROW_FOOTPRINT
    found = error_glyphs(view, model, frame, footprint)
    rows, columns = np.nonzero(lit_cells(view.truth, model.chosen, frame))
    gold = look.theme.truth
    if found.crowded:
        red, green, blue = mix(np.array(look.theme.background), np.array(gold), 0.55).tolist()
        stamp(canvas, columns, rows, "." if look.ascii else "·", (red, green, blue), bold=False)
    else:
        stamp(canvas, columns, rows, look.glyphs.truth, gold, bold=False)
    draw = _arcs if look.pictures else _arrows
    draw(canvas, found, view.y_down, look)
    _middles(canvas, found, look)


def _middles(canvas: Canvas, found: ErrorGlyphs, look: RenderOptions) -> None:
    """The truth of one instance, or how many are taken together."""
    for (column, row), size in zip(found.centres.tolist(), found.counts.tolist(), strict=True):
        glyph = look.glyphs.truth if size == 1 else str(size) if size < 10 else "+"
        canvas.put(int(column), int(row), glyph, look.theme.truth, bold=True)


def _arcs(canvas: Canvas, found: ErrorGlyphs, y_down: bool, look: RenderOptions) -> None:
    sim, real = (_ring(canvas, found, part, y_down) for part in (found.sim, found.real))
    theme = look.theme
    counts = [
        part.reshape(canvas.height, 4, canvas.width, 2).sum(axis=(1, 3))
        for part in (sim, real, sim & real)
    ]
    colours = np.empty((canvas.height, canvas.width, 3), dtype=np.uint8)
    colours[:] = theme.sim
    colours[counts[1] > counts[0]] = theme.real
    colours[counts[2] > 0] = theme.both
    braille(canvas, 0, 0, sim | real, colours)
    _tips(canvas, found, y_down, look)


def _ring(canvas: Canvas, found: ErrorGlyphs, vectors: NDArray[np.float64], y_down: bool) -> Grid:
    """The arcs of one side as braille dots (4 rows, 2 columns per cell)."""
    half = np.radians(arc_degrees(vectors, found.full))[:, None] / 2
    angles = arc_turns(vectors, y_down)[:, None] + half * np.linspace(-1, 1, 32)
    angles, radii = angles[..., None], np.array(RADII)
    middle = np.floor(found.centres)[:, None, None] + 0.5
    columns = middle[..., 0] + radii / 2 * np.cos(angles)
    rows = middle[..., 1] + radii / 4 * np.sin(angles)
    known = np.isfinite(columns)
    return dot_grid(columns[known], rows[known], canvas.width, canvas.height)


def _tips(canvas: Canvas, found: ErrorGlyphs, y_down: bool, look: RenderOptions) -> None:
    """The middle of each arc as the side's glyph, one for both where they meet."""
    theme, glyphs = look.theme, look.glyphs
    places = [_tip_cells(found, part, y_down) for part in (found.sim, found.real)]
    for sim, real in zip(*(part.tolist() for part in places), strict=True):
        if sim == real:
            canvas.put(sim[0], sim[1], glyphs.both, theme.both, bold=True)
            continue
        canvas.put(sim[0], sim[1], glyphs.sim, theme.sim, bold=True)
        canvas.put(real[0], real[1], glyphs.real, theme.real, bold=True)


def _tip_cells(found: ErrorGlyphs, vectors: NDArray[np.float64], y_down: bool) -> NDArray[np.intp]:
    turns = arc_turns(vectors, y_down)
    middle = np.floor(found.centres) + 0.5
    step = np.stack([np.cos(turns) * RADII[-1] / 2, np.sin(turns) * RADII[-1] / 4], axis=1)
    return np.where(np.isfinite(step), np.floor(middle + step), -1).astype(np.intp)


def _arrows(canvas: Canvas, found: ErrorGlyphs, y_down: bool, look: RenderOptions) -> None:
    """Beside the point an arrow in the error's direction, then the side's letter and the size."""
    theme, glyphs = look.theme, look.glyphs
    sim, real = (_octants(part, y_down) for part in (found.sim, found.real))
    sizes = [_digits(part, found.full) for part in (found.sim, found.real)]
    middles = np.floor(found.centres).astype(int).tolist()
    for index, (column, row) in enumerate(middles):
        texts = [side[index] for side in sizes]
        if sim[index] == real[index]:
            label = glyphs.both + "".join(texts)
            _arrow(canvas, column, row, sim[index], None, label, theme.both, look)
            continue
        _arrow(canvas, column, row, sim[index], real[index], glyphs.sim + texts[0], theme.sim, look)
        _arrow(
            canvas, column, row, real[index], sim[index], glyphs.real + texts[1], theme.real, look
        )


def _arrow(
    canvas: Canvas,
    column: int,
    row: int,
    octant: int,
    other: int | None,
    label: str,
    colour: Rgb,
    look: RenderOptions,
) -> None:
    """One arrow; above and below the point its label avoids the other arrow's side."""
    if octant < 0:
        return
    across, down = OCTANTS[octant]
    leftwards = across < 0
    if across == 0 and other is not None and other >= 0:
        leftwards = OCTANTS[other] == (1, down)
    canvas.put(column + across, row + down, look.glyphs.arrows[octant], colour, bold=True)
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


def glyph_legend(view: GeoMapInput, model: GeoMapModel, look: RenderOptions) -> list[LegendPart]:
    """What the arcs or arrows mean."""
    theme, glyphs = look.theme, look.glyphs
    full = f"{short(full_scale(view), 2)} m"
    scale = f"{LARGEST:g}{glyphs.degree} = {full}" if look.pictures else f"9 = {full}"
    marks = (
        (f"{glyphs.sim} ", theme.sim),
        ("sim  ", theme.muted),
        (f"{glyphs.real} ", theme.real),
        ("real  ", theme.muted),
        (f"{glyphs.both} ", theme.both),
        (f"both  {scale}", theme.muted),
    )
    parts = [words(marks)]
    if model.lit > 1:
        parts.append(words((("2..9 + ", theme.truth), ("mean of so many", theme.muted))))
    return parts
