"""Marks in true pixels: dots by value, outlines, lines, arcs and arrows on an image."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from s2rtui.canvas.colour import Pixels, Rgb

Grid = NDArray[np.bool_]
Levels = NDArray[np.int16]
Place = tuple[float, float]
"""Column and row in pixels."""


def disc(radius: float) -> Grid:
    """A filled circle as a square array of an odd size."""
    down, across = _square(radius)
    return np.asarray(np.hypot(across, down) <= radius + 0.25)


def diamond(radius: float) -> Grid:
    """A filled diamond as a square array of an odd size."""
    down, across = _square(radius)
    return np.asarray(np.abs(across) + np.abs(down) <= radius + 0.25)


def triangle(radius: float, up: bool) -> Grid:
    """A filled triangle with a horizontal side as a square array of an odd size."""
    down, across = _square(radius)
    height = down + radius if up else radius - down
    return np.asarray((np.abs(across) <= height / 2 + 0.25) & (height <= 2 * radius))


def hollow(shape: Grid) -> Grid:
    """The outline of a shape, about a third of its radius wide."""
    size = shape.shape[0] // 2
    inner = np.zeros_like(shape)
    width = max(1, round(size / 3))
    core = shape[width:-width, width:-width]
    inner[width:-width, width:-width] = (
        core
        & np.roll(shape, width, 0)[width:-width, width:-width]
        & np.roll(shape, -width, 0)[width:-width, width:-width]
        & np.roll(shape, width, 1)[width:-width, width:-width]
        & np.roll(shape, -width, 1)[width:-width, width:-width]
    )
    return shape & ~inner


def _square(radius: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    size = max(0, int(np.ceil(radius)))
    down, across = np.mgrid[-size : size + 1, -size : size + 1].astype(np.float64)
    return down, across


def highest_at(places: NDArray[np.float64], levels: ArrayLike, shape: tuple[int, int]) -> Levels:
    """(height, width): the highest of `levels` (N,), 0 or more, at the pixels of `places` (N, 2).

    -1 where there is no place. Places outside the image or unknown are left out.
    """
    height, width = shape
    top = np.full(height * width, -1, dtype=np.int16)
    with np.errstate(invalid="ignore"):
        column, row = np.floor(places[:, 0]), np.floor(places[:, 1])
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    at = (row[inside] * width + column[inside]).astype(np.intp)
    wanted = np.broadcast_to(np.asarray(levels, dtype=np.int16), len(places))[inside]
    np.maximum.at(top, at, wanted)
    return top.reshape(height, width)


def stamped(top: Levels, shape: Grid) -> Levels:
    """Put a shape around each place of `top`; where shapes overlap, the highest level is on top."""
    size = shape.shape[0] // 2
    height, width = top.shape
    padded = np.full((height + 2 * size, width + 2 * size), -1, dtype=np.int16)
    rows, columns = np.nonzero(top >= 0)
    sparse = len(rows) * int(shape.sum()) < top.size
    if sparse:
        down, across = np.nonzero(shape)
        at = (rows[:, None] + down) * padded.shape[1] + columns[:, None] + across
        values = np.broadcast_to(top[rows, columns][:, None], at.shape)
        np.maximum.at(padded.reshape(-1), at.reshape(-1), values.reshape(-1))
        return padded[size : size + height, size : size + width]
    for y, x in np.argwhere(shape).tolist():
        part = padded[y : y + height, x : x + width]
        np.maximum(part, top, out=part)
    return padded[size : size + height, size : size + width]


def draw_dots_by_level(
    image: Pixels, top: Levels, colours: Pixels, shape: Grid, outline: Rgb | None = None
) -> None:
    """Draw a shape at each place of `top` (see `highest_at`) in the colour of its level (n, 3).

    `outline` surrounds each group of shapes that touch by one pixel. In place.
    """
    drawn = stamped(top, shape)
    inked = drawn >= 0
    if outline is not None:
        around = stamped(np.where(inked, 0, -1).astype(np.int16), disc(1.0)) >= 0
        image[around & ~inked] = outline
    image[inked] = colours[drawn[inked]]


def draw_lines(
    image: Pixels, lines: Iterable[tuple[Place, Place]], colour: Rgb, width: int = 1
) -> Pixels:
    """Draw lines between places; returns a new image."""
    from PIL import Image, ImageDraw

    picture = Image.fromarray(image)
    pen = ImageDraw.Draw(picture)
    for start, end in lines:
        pen.line([start, end], fill=colour, width=width)
    return np.array(picture)


def draw_dotted_lines(
    image: Pixels, lines: Iterable[tuple[Place, Place]], colour: Rgb, every: int = 4
) -> None:
    """Draw each `every`-th pixel of straight lines; in place."""
    height, width = image.shape[:2]
    for (x0, y0), (x1, y1) in lines:
        length = min(1 << 14, max(abs(x1 - x0), abs(y1 - y0)))
        along = np.linspace(0.0, 1.0, max(2, int(length / every) + 1))
        columns, rows = np.floor(x0 + (x1 - x0) * along), np.floor(y0 + (y1 - y0) * along)
        inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        image[rows[inside].astype(np.intp), columns[inside].astype(np.intp)] = colour


def arc_pixels(
    shape: tuple[int, int], arcs: Iterable[tuple[Place, float, float]], radius: float, width: int
) -> Grid:
    """(height, width): the pixels of arcs (centre, middle, degrees).

    `middle` is an angle in degrees, clockwise from the right.
    """
    from PIL import Image, ImageDraw

    picture = Image.new("1", (shape[1], shape[0]))
    pen = ImageDraw.Draw(picture)
    for (x, y), middle, degrees in arcs:
        box = (x - radius, y - radius, x + radius, y + radius)
        pen.arc(box, middle - degrees / 2, middle + degrees / 2, fill=1, width=width)
    return np.asarray(picture, dtype=np.bool_)


def draw_ring(
    image: Pixels, at: Place, colour: Rgb, outline: Rgb, radius: float, turn: float | None = None
) -> Pixels:
    """Draw a ring, and a line from it in the direction `turn` (radians clockwise from the right).

    Both have an outline of one pixel, which keeps them visible on any ground; returns a new image.
    """
    from PIL import Image, ImageDraw

    picture = Image.fromarray(image)
    pen = ImageDraw.Draw(picture)
    x, y = at
    width = max(2, round(radius / 3))
    for ink, more in ((outline, 1), (colour, 0)):
        if turn is not None:
            dx, dy = np.cos(turn), np.sin(turn)
            start = (x + dx * radius, y + dy * radius)
            end = (x + dx * radius * 2.2, y + dy * radius * 2.2)
            pen.line([start, end], fill=ink, width=width + 2 * more)
        box = (x - radius - more, y - radius - more, x + radius + more, y + radius + more)
        pen.ellipse(box, outline=ink, width=width + 2 * more)
    return np.array(picture)
