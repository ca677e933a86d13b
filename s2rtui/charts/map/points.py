"""What stands on a map: the unselected in grey, values, predictions with lines, the cursor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import Chosen
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.canvas.canvas import Canvas
from s2rtui.canvas.colour import Rgb, legible, turbo
from s2rtui.canvas.raster import braille, braille_bits, dot_grid, ground, segment_dots
from s2rtui.canvas.render_options import RenderOptions, heading_arrow
from s2rtui.charts.shared.inputs import Floats, GeoMapInput, LivePose
from s2rtui.charts.shared.legend import ramp_for_values
from s2rtui.charts.shared.map_model import GeoMapModel, lined
from s2rtui.charts.shared.points import level_shares, lit_cells, other_dots, top_levels

Places = NDArray[np.intp]


def draw_others(
    canvas: Canvas, truth: Floats, chosen: Chosen, frame: MapFrame, look: RenderOptions
) -> None:
    """What is not selected: grey dots."""
    draw_dots(canvas, other_dots(truth, chosen, frame), look.theme.unselected, look)


def draw_dots(
    canvas: Canvas, grid: NDArray[np.bool_], colour: Rgb, look: RenderOptions, glyph: str = ""
) -> None:
    """Braille dots (4 rows, 2 columns per cell); in ASCII one glyph, by default a faint one."""
    if not look.ascii:
        braille(canvas, 0, 0, grid, np.array(colour, dtype=np.uint8))
        return
    rows, columns = np.nonzero(braille_bits(grid))
    stamp(canvas, columns, rows, glyph or look.glyphs.unselected, colour, bold=False)


def stamp(
    canvas: Canvas, columns: Places, rows: Places, glyph: str, colour: Rgb, bold: bool = True
) -> None:
    """A glyph in each of some cells."""
    ground(canvas, columns, rows)
    canvas.char[rows, columns] = glyph
    canvas.bold[rows, columns] = bold
    canvas.fg[rows, columns] = colour


def draw_values(
    canvas: Canvas, view: GeoMapInput, model: GeoMapModel, frame: MapFrame, look: RenderOptions
) -> None:
    """The selected coloured by value, the largest of a cell on top; digits where colours lack."""
    top = top_levels(view.truth, view.values, model.value_range, model.chosen, frame)
    rows, columns = np.nonzero(top >= 0)
    shares = level_shares(top[rows, columns])
    known = np.isfinite(shares)
    stamp(canvas, columns, rows, look.glyphs.selected, look.theme.text)
    if (digits := ramp_for_values(look)) is not None:
        steps = np.clip(np.nan_to_num(shares) * len(digits), 0, len(digits) - 1).astype(np.intp)
        canvas.char[rows, columns] = np.where(known, np.array(list(digits))[steps], "?")
    canvas.fg[rows[known], columns[known]] = legible(turbo(shares[known]), look.theme)


def draw_predictions(
    canvas: Canvas, view: GeoMapInput, model: GeoMapModel, frame: MapFrame, look: RenderOptions
) -> None:
    """Sim, real and truth of the selected; lines join them where they are few."""
    theme, glyphs = look.theme, look.glyphs
    _lines(canvas, view, lined(view, model, frame), frame, look)
    for points, glyph, colour in (
        (view.sim, glyphs.sim, theme.sim),
        (view.real, glyphs.real, theme.real),
        (view.truth, glyphs.truth, theme.truth),
    ):
        rows, columns = np.nonzero(lit_cells(points, model.chosen, frame))
        stamp(canvas, columns, rows, glyph, colour)


def _lines(
    canvas: Canvas, view: GeoMapInput, ids: Places, frame: MapFrame, look: RenderOptions
) -> None:
    """From the truth to both predictions, in braille or in full stops."""
    starts = frame.to_cells(np.asarray(view.truth)[ids])
    for side, colour in ((view.sim, look.theme.sim), (view.real, look.theme.real)):
        grid = np.zeros((4 * canvas.height, 2 * canvas.width), dtype=np.bool_)
        ends = frame.to_cells(np.asarray(side)[ids])
        for start, end in zip(starts, ends, strict=True):
            if np.isfinite(start).all() and np.isfinite(end).all():
                columns, rows = segment_dots(start[0], start[1], end[0], end[1])
                grid |= dot_grid(columns, rows, canvas.width, canvas.height)
        draw_dots(canvas, grid, colour, look, ".")


def draw_cursor(
    canvas: Canvas, view: GeoMapInput, cursor: int | None, frame: MapFrame, look: RenderOptions
) -> None:
    """The cursor's pose with its heading; in mode "full" its two predictions with theirs."""
    if cursor is None:
        return
    theme, glyphs = look.theme, look.glyphs
    if view.mode == "full":
        _pose(canvas, view.sim, view.sim_headings, cursor, frame, look, glyphs.sim, theme.sim)
        _pose(canvas, view.real, view.real_headings, cursor, frame, look, glyphs.real, theme.real)
    draw_pose(canvas, view.truth, view.headings, cursor, frame, look)


def draw_live(
    canvas: Canvas, live: Sequence[LivePose], frame: MapFrame, look: RenderOptions
) -> None:
    """Predictions that are not stored, with their headings."""
    theme, glyphs = look.theme, look.glyphs
    for pose in live:
        glyph, colour = (glyphs.sim, theme.sim) if pose.side == "sim" else (glyphs.real, theme.real)
        points, headings = np.array([[pose.x, pose.y]]), np.array([pose.heading])
        _pose(canvas, points, headings, 0, frame, look, glyph, colour)


def draw_pose(
    canvas: Canvas,
    points: Floats,
    headings: Floats | None,
    iid: int,
    frame: MapFrame,
    look: RenderOptions,
) -> None:
    """The cursor's glyph at one of `points`, an arrow beside it where its heading is known."""
    glyph, colour = look.glyphs.cursor, look.theme.cursor
    _pose(canvas, points, headings, iid, frame, look, glyph, colour)


def _pose(
    canvas: Canvas,
    points: Floats,
    headings: Floats | None,
    iid: int,
    frame: MapFrame,
    look: RenderOptions,
    glyph: str,
    colour: Rgb,
) -> None:
    place = frame.to_cells(np.asarray(points)[iid])[0]
    if not (np.isfinite(place).all() and (place >= 0).all()):
        return
    column, row = int(place[0]), int(place[1])
    if column >= canvas.width or row >= canvas.height:
        return
    one = np.array([column]), np.array([row])
    stamp(canvas, *one, glyph, colour)
    if headings is not None and np.isfinite(headings[iid]):
        arrow, across, down = heading_arrow(float(headings[iid]), frame.y_down, look.glyphs)
        column, row = column + across, row + down
        if 0 <= column < canvas.width and 0 <= row < canvas.height:
            stamp(canvas, np.array([column]), np.array([row]), arrow, colour)
