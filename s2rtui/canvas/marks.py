"""Brushing: panels convert between cells and data, marks are shapes that the user draws."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from s2rstore.geometry import angles
from s2rtui.canvas.canvas import Canvas
from s2rtui.canvas.raster import cells_with_dots, draw_braille, segment_dots

Point = tuple[float, float]
Shape = Literal["plane", "range", "turn", "steps"]
"""The coordinates that count: plane: x and y. range: x. turn: x, degrees. steps: integer y."""


@dataclass(frozen=True, slots=True)
class PlotArea:
    """A rectangle of cells in a view that can be brushed, with its data coordinates.

    `to_data` converts a place in the view (column, row; the middle of a cell is at + 0.5),
    `to_cells` is its inverse. `shape` says which of the coordinates count.
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
class BrushShape:
    """A brush mark in data coordinates: two opposite corners, or a polygon if `lasso`."""

    panel: str
    points: tuple[Point, ...]
    lasso: bool = False


def panel_at(panels: Sequence[PlotArea], column: int, row: int) -> PlotArea | None:
    """The panel under a cell."""
    return next((panel for panel in panels if panel.holds(column, row)), None)


def draw_ground(canvas: Canvas, panel: PlotArea, mark: BrushShape | None) -> None:
    """Highlight the columns of a range that is marked on a panel; a turn may pass its ends."""
    mark = mark_on_panel(mark, panel.name)
    if mark is None or panel.shape not in ("range", "turn"):
        return
    middles = (np.arange(panel.width) + 0.5 + panel.x).tolist()
    x = np.array([panel.to_data(column, panel.y)[0] for column in middles])
    ends = _end_columns(panel, mark)
    if panel.shape == "turn":
        middle, half = mark_arc(mark)
        inside = np.abs(angles.wrap_degrees(x - middle)) <= half
    else:
        inside = (x >= panel.to_data(ends[0], 0)[0]) & (x <= panel.to_data(ends[1] + 1, 0)[0])
    rows = slice(panel.y, panel.y + panel.height)
    canvas.bg[rows, panel.x : panel.x + panel.width][:, inside] = canvas.theme.highlight


def _end_columns(panel: PlotArea, mark: BrushShape) -> tuple[int, int]:
    """The columns of the ends of a range, within its panel."""
    bounds = mark_range(mark)
    if panel.shape == "turn":
        middle, half = mark_arc(mark)
        bounds = wrap_degrees(middle - half), wrap_degrees(middle + half)
    last = panel.x + panel.width - 1
    low, high = (min(max(int(panel.to_cells(x, 0.0)[0]), panel.x), last) for x in bounds)
    return low, high


def draw_mark(canvas: Canvas, panel: PlotArea, mark: BrushShape | None) -> None:
    """Draw the outline of a mark on a plane, clipped to its panel, or the ends of a range."""
    mark = mark_on_panel(mark, panel.name)
    if mark is None:
        return
    if panel.shape == "plane":
        corners = [panel.to_cells(*point) for point in mark.points]
        (_outline if mark.lasso else _frame)(canvas, panel, corners)
    elif panel.shape != "steps":
        glyphs = canvas.glyphs.scale_left, canvas.glyphs.scale_right
        for x, glyph in zip(_end_columns(panel, mark), glyphs, strict=True):
            for y in range(panel.y, panel.y + panel.height):
                canvas.put(x, y, glyph, canvas.theme.truth, bold=True)


def _frame(canvas: Canvas, panel: PlotArea, corners: list[Point]) -> None:
    """A rectangle of line glyphs, at least one cell large."""
    columns = sorted(int(np.floor(column)) for column, _ in (corners[0], corners[-1]))
    rows = sorted(int(np.floor(row)) for _, row in (corners[0], corners[-1]))
    (left, right), (top, bottom) = columns, rows
    cells = [(column, row) for row in (top, bottom) for column in range(left, right + 1)]
    cells += [(column, row) for column in (left, right) for row in range(top, bottom + 1)]
    held = [cell for cell in cells if panel.holds(*cell)]
    glyphs = canvas.glyphs
    for column, row in held:
        edge = row in (top, bottom)
        corner = edge and column in (left, right)
        glyph = "+" if corner else glyphs.horizontal if edge else glyphs.vertical
        canvas.put(column, row, glyph, canvas.theme.truth, bold=True)


def _outline(canvas: Canvas, panel: PlotArea, corners: list[Point]) -> None:
    """A closed polygon in braille dots, in ASCII in full stops."""
    lines = zip(corners, [*corners[1:], corners[0]], strict=True)
    dots = segment_dots(lines, canvas.width, canvas.height)
    inside = np.zeros_like(dots)
    rows_held = slice(4 * panel.y, 4 * (panel.y + panel.height))
    columns_held = slice(2 * panel.x, 2 * (panel.x + panel.width))
    inside[rows_held, columns_held] = dots[rows_held, columns_held]
    if not canvas.options.ascii:
        draw_braille(canvas, inside, canvas.theme.truth)
        return
    for row, column in np.argwhere(cells_with_dots(inside)):
        canvas.put(int(column), int(row), ".", canvas.theme.truth, bold=True)


def mark_on_panel(mark: BrushShape | None, panel: str) -> BrushShape | None:
    """The mark if it lies on `panel` and has a point, else None."""
    return mark if mark is not None and mark.panel == panel and mark.points else None


def mark_range(mark: BrushShape) -> tuple[float, float]:
    """The smaller and the larger x."""
    low, high = sorted((mark.points[0][0], mark.points[-1][0]))
    return low, high


def mark_rows(mark: BrushShape) -> tuple[int, int]:
    """The smaller and the larger y as integers, both included."""
    low, high = sorted(round(y) for _, y in (mark.points[0], mark.points[-1]))
    return low, high


def mark_arc(mark: BrushShape) -> tuple[float, float]:
    """The centre and half width of an arc in degrees, from the first point to the last.

    Like a range of headings in the selection language; 360 degrees or more mean the full circle.
    """
    start, stop = mark.points[0][0], mark.points[-1][0]
    width = min(stop - start, 360.0) if stop >= start else (stop - start) % 360
    return wrap_degrees(start + width / 2), width / 2


def wrap_degrees(degrees: float) -> float:
    """Map an angle to [-180, 180)."""
    turned = math.fmod(degrees + 180, 360)
    turned = turned + 360 if turned < 0 else turned
    return turned - 180 if turned < 360 else -180.0
