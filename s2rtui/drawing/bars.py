"""Bars in eighths of cells: vertical ones per column, horizontal ones per row."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from s2rtui.canvas import Canvas, ColourMode, Rgb, mix

UP = np.array(list(" ▁▂▃▄▅▆▇█"))
RIGHT = np.array(list(" ▏▎▍▌▋▊▉█"))
Bars = tuple[ArrayLike, ArrayLike]
"""Lengths 0 .. 1 of the highlighted bars, and of the grey ones behind them."""
SOLID = 0.55
"""Strength of grey areas: paler than grey dots, so that highlighted bars stand out."""


def draw_vertical_bars(canvas: Canvas, bars: Bars, colour: Rgb) -> None:
    """Draw a bar per column, upwards from the last row."""
    highlighted, grey = (_steps(part, canvas.height) for part in bars)
    level = 8 * np.arange(canvas.height)[::-1, None]
    _stamp(canvas, 0, 0, highlighted[None] - level, grey[None] - level, UP, level == 0, colour)


def draw_horizontal_bars(
    canvas: Canvas, x: int, y: int, columns: int, bars: Bars, colour: Rgb
) -> None:
    """Draw a bar per row, from `x` to the right within `columns`."""
    highlighted, grey = (_steps(part, columns) for part in bars)
    level = 8 * np.arange(columns)[None]
    highlighted, grey = highlighted[:, None] - level, grey[:, None] - level
    _stamp(canvas, x, y, highlighted, grey, RIGHT, level == 0, colour)


def put_over_bar(
    canvas: Canvas, x: int, y: int, glyph: str, colour: Rgb, bold: bool = True
) -> None:
    """Put a glyph; a solid bar under it becomes its background."""
    solid = 0 <= x < canvas.width and 0 <= y < canvas.height and canvas.char[y, x] == "█"
    red, green, blue = canvas.fg[y, x].tolist() if solid else (0, 0, 0)
    canvas.put(x, y, glyph, colour, (red, green, blue) if solid else None, bold=bold)


def _steps(lengths: ArrayLike, cells: int) -> NDArray[np.intp]:
    """Lengths in eighths of a cell, at least one for any positive length."""
    steps = np.ceil(np.clip(lengths, 0, 1) * cells * 8 - 1e-9)
    return np.atleast_1d(np.maximum(steps, np.asarray(lengths) > 0)).astype(np.intp)


def _stamp(
    canvas: Canvas,
    x: int,
    y: int,
    highlighted: NDArray[np.intp],
    grey: NDArray[np.intp],
    glyphs: NDArray[np.str_],
    foot: NDArray[np.bool_],
    colour: Rgb,
) -> None:
    """Draw cells with `highlighted` coloured eighths and `grey` grey ones, clipped."""
    into = (slice(y, y + highlighted.shape[0]), slice(x, x + highlighted.shape[1]))
    room = canvas.char[into].shape
    grey_ink = mix(canvas.theme.background, canvas.theme.unselected, SOLID)
    part, full = (np.clip(steps[: room[0], : room[1]], 0, 8) for steps in (highlighted, grey))
    full = np.maximum(part, full)
    drawn, some = full > 0, part > 0
    if canvas.options.ascii:
        lower = np.broadcast_to(foot, highlighted.shape)[: room[0], : room[1]]
        inked = np.where(some & ((2 * part >= full) | lower), "#", ".")
    elif canvas.options.mode is ColourMode.NONE:
        inked = np.where(some, glyphs[part], "░")
    else:
        inked = np.where(some, glyphs[part], glyphs[full])
        canvas.bg[into][some & (part < full) & (full == 8)] = grey_ink
    canvas.char[into][drawn] = inked[drawn]
    canvas.fg[into][drawn & some] = colour
    canvas.fg[into][drawn & ~some] = grey_ink
