"""Where a view can be brushed: panels that turn cells into data and back, and the pending mark."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from s2rtui.canvas.canvas import Canvas
from s2rtui.canvas.raster import dot_grid, draw_braille, flatten_half_blocks, segment_dots
from s2rtui.canvas.render_options import RenderOptions

Point = tuple[float, float]
Shape = Literal["plane", "range", "turn", "steps"]
"""plane: x and y. range: x. turn: x, degrees that wrap. steps: whole y, 0 .. n - 1."""


@dataclass(frozen=True, slots=True)
class Panel:
    """A part of a view that can be brushed: its place in cells, and its data coordinates.

    `to_data` takes a cell (column, row) of the view, its middle is at + 0.5; `to_cells` is its
    inverse. `shape` says which of the coordinates count.
    """

    name: str
    shape: Shape
    x: int
    y: int
    width: int
    height: int
    to_data: Callable[[float, float], Point]
    to_cells: Callable[[float, float], Point]

    def holds(self, column: int, row: int) -> bool:
        """Whether a cell lies in the panel."""
        across = self.x <= column < self.x + self.width
        return across and self.y <= row < self.y + self.height


@dataclass(frozen=True, slots=True)
class Mark:
    """A brush that is being drawn: two opposite corners, or (`lasso`) a polygon, in data."""

    panel: str
    points: tuple[Point, ...]
    lasso: bool = False


def panel_at(panels: Sequence[Panel], column: int, row: int) -> Panel | None:
    """The panel under a cell."""
    return next((panel for panel in panels if panel.holds(column, row)), None)


def draw_mark(canvas: Canvas, panel: Panel, mark: Mark | None, options: RenderOptions) -> None:
    """The outline of a mark on a plane, clipped to its panel."""
    if mark is None or mark.panel != panel.name or panel.shape != "plane" or not mark.points:
        return
    corners = [panel.to_cells(*point) for point in mark.points]
    if mark.lasso:
        _outline(canvas, panel, corners, options)
    else:
        _frame(canvas, panel, corners, options)


def _frame(canvas: Canvas, panel: Panel, corners: list[Point], options: RenderOptions) -> None:
    """A box in line glyphs, at least one cell."""
    columns = sorted(int(np.floor(column)) for column, _ in (corners[0], corners[-1]))
    rows = sorted(int(np.floor(row)) for _, row in (corners[0], corners[-1]))
    (left, right), (top, bottom) = columns, rows
    cells = [(column, row) for row in (top, bottom) for column in range(left, right + 1)]
    cells += [(column, row) for column in (left, right) for row in range(top, bottom + 1)]
    held = [cell for cell in cells if panel.holds(*cell)]
    if held:
        at = np.array(held, dtype=np.intp)
        flatten_half_blocks(canvas, at[:, 0], at[:, 1])
    glyphs = options.glyphs
    for column, row in held:
        edge = row in (top, bottom)
        corner = edge and column in (left, right)
        glyph = "+" if corner else glyphs.horizontal if edge else glyphs.vertical
        canvas.put(column, row, glyph, options.theme.truth, bold=True)


def _outline(canvas: Canvas, panel: Panel, corners: list[Point], options: RenderOptions) -> None:
    """A closed polygon: braille, or full stops where only ASCII is allowed."""
    dots = np.zeros((4 * canvas.height, 2 * canvas.width), dtype=np.bool_)
    for (x0, y0), (x1, y1) in zip(corners, [*corners[1:], corners[0]], strict=True):
        columns, rows = segment_dots(x0, y0, x1, y1)
        dots |= dot_grid(columns, rows, canvas.width, canvas.height)
    inside = np.zeros_like(dots)
    rows_held = slice(4 * panel.y, 4 * (panel.y + panel.height))
    columns_held = slice(2 * panel.x, 2 * (panel.x + panel.width))
    inside[rows_held, columns_held] = dots[rows_held, columns_held]
    if not options.ascii:
        draw_braille(canvas, 0, 0, inside, np.array(options.theme.truth, dtype=np.uint8))
        return
    held = inside.reshape(canvas.height, 4, canvas.width, 2).any(axis=(1, 3))
    for row, column in np.argwhere(held):
        canvas.put(int(column), int(row), ".", options.theme.truth, bold=True)


def mark_on_panel(mark: Mark | None, panel: str) -> Mark | None:
    """The mark where it belongs to `panel` and holds a point."""
    return mark if mark is not None and mark.panel == panel and mark.points else None


def mark_range(mark: Mark) -> tuple[float, float]:
    """The lower and the upper end of x."""
    low, high = sorted((mark.points[0][0], mark.points[-1][0]))
    return low, high


def mark_rows(mark: Mark) -> tuple[int, int]:
    """The first and the last whole y, both included."""
    low, high = sorted(round(y) for _, y in (mark.points[0], mark.points[-1]))
    return low, high


def mark_arc(mark: Mark) -> tuple[float, float]:
    """The middle and half the width in degrees, from the first end turning to the last.

    As the language's range of a heading; ends further apart than a turn mean all of it.
    """
    start, stop = mark.points[0][0], mark.points[-1][0]
    width = min(stop - start, 360.0) if stop >= start else (stop - start) % 360
    return wrap_degrees(start + width / 2), width / 2


def wrap_degrees(degrees: float) -> float:
    """-180 up to, but without, 180."""
    turned = math.fmod(degrees + 180, 360)
    turned = turned + 360 if turned < 0 else turned
    return turned - 180 if turned < 360 else -180.0
