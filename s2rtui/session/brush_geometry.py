"""Geometry of brushes: start, move, stretch and scale a mark on a panel.

Marks are in data coordinates and move by cells; marks on a heading move by bins of 5 degrees.
"""

from __future__ import annotations

from dataclasses import replace

from s2rtui.canvas.marks import BrushShape, PlotArea, Point
from s2rtui.session.state import Brush

TURN_STEP = 5.0
MAX_CORNERS = 64
"""Corners of a lasso that the selection language accepts."""
_SHARE = 0.12
"""Half of a new box, as a share of its panel."""


def started(view: str, panel: PlotArea, at: Point | None, lasso: bool = False) -> Brush:
    """A new brush around a data point (default: the panel's centre)."""
    middle = panel.x + panel.width / 2, panel.y + panel.height / 2
    column, row = middle if at is None else panel.to_cells(*at)
    column = min(max(column, panel.x + 0.5), panel.x + panel.width - 0.5)
    row = min(max(row, panel.y + 0.5), panel.y + panel.height - 0.5)
    centre = panel.to_data(column, row) if at is None else at
    if panel.shape == "steps":
        return Brush(view, BrushShape(panel.name, (centre, centre)))
    if panel.shape == "turn":
        low, high = centre[0] - 2 * TURN_STEP, centre[0] + 2 * TURN_STEP
        return Brush(view, BrushShape(panel.name, ((low, centre[1]), (high, centre[1]))))
    if lasso and panel.shape == "plane":
        return Brush(view, BrushShape(panel.name, (panel.to_data(column, row),), lasso=True))
    wide, high_ = max(1.0, _SHARE * panel.width), max(1.0, _SHARE * panel.height)
    corners = (panel.to_data(column - wide, row - high_), panel.to_data(column + wide, row + high_))
    return Brush(view, BrushShape(panel.name, corners))


def dragged(
    view: str, panel: PlotArea, start: Point, end: Point, trail: tuple[Point, ...]
) -> Brush:
    """A brush between two cells (column, row), or a lasso along a trail of cells."""
    if trail and panel.shape == "plane":
        points = tuple(panel.to_data(*cell) for cell in trail)
        return Brush(view, BrushShape(panel.name, points, lasso=True), len(points))
    if panel.shape in ("plane", "range"):
        start, end = _outer_edges(start, end)
    points = panel.to_data(*start), panel.to_data(*end)
    if panel.shape == "turn" and (points[1][0] - points[0][0]) % 360 > 180:
        points = points[1], points[0]  # dragged backwards: take the shorter arc
    return Brush(view, BrushShape(panel.name, points))


def moved(brush: Brush, panel: PlotArea, across: int, down: int) -> Brush:
    """Move a box, or the loose end of a lasso, by cells."""
    points = brush.mark.points
    if brush.mark.lasso:
        return _with_points(brush, (*points[:-1], _shift(panel, points[-1], across, down)))
    shifted = tuple(_shift(panel, point, across, down) for point in points)
    return _with_points(brush, shifted) if _is_on_panel(panel, shifted) else brush


def stretched(brush: Brush, panel: PlotArea, across: int, down: int) -> Brush:
    """Move the second corner by cells."""
    if brush.mark.lasso:
        return moved(brush, panel, across, down)
    first, *_, last = brush.mark.points
    end = _shift(panel, last, across, down)
    wide = (last[0] - first[0]) % 360 + end[0] - last[0]
    if panel.shape == "turn" and not TURN_STEP <= wide < 360:
        return brush
    return _with_points(brush, (first, end))


def scaled(brush: Brush, panel: PlotArea, steps: int) -> Brush:
    """Enlarge (steps > 0) or shrink a box on every side; it never inverts."""
    if brush.mark.lasso:
        return brush
    first, *_, last = brush.mark.points
    if panel.shape == "turn":
        low, high = first[0] - steps * TURN_STEP, last[0] + steps * TURN_STEP
        is_valid = TURN_STEP <= high - low < 360
        return _with_points(brush, ((low, first[1]), (high, last[1]))) if is_valid else brush
    (x0, y0), (x1, y1) = panel.to_cells(*first), panel.to_cells(*last)
    grow = 0 if panel.shape == "steps" else steps
    tall = 0 if panel.shape == "range" else steps
    sign_x, sign_y = (1 if x1 >= x0 else -1), (1 if y1 >= y0 else -1)
    corners = (x0 - sign_x * grow, y0 - sign_y * tall), (x1 + sign_x * grow, y1 + sign_y * tall)
    if (corners[1][0] - corners[0][0]) * sign_x < 0 or (corners[1][1] - corners[0][1]) * sign_y < 0:
        return brush
    return _with_points(brush, tuple(panel.to_data(*corner) for corner in corners))


def as_lasso(brush: Brush) -> Brush:
    """A box as a lasso with four corners, the last one loose."""
    (x0, y0), *_, (x1, y1) = brush.mark.points
    corners = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
    return Brush(brush.view, replace(brush.mark, points=corners, lasso=True), len(corners) - 1)


def as_box(brush: Brush) -> Brush:
    """The smallest box that holds a lasso."""
    x, y = zip(*brush.mark.points, strict=True)
    corners = ((min(x), min(y)), (max(x), max(y)))
    return Brush(brush.view, replace(brush.mark, points=corners, lasso=False))


def with_corner(brush: Brush) -> Brush:
    """Fix the loose end of a lasso as a corner; a new loose end starts there."""
    points = brush.mark.points
    return replace(_with_points(brush, (*points, points[-1])), corners=brush.corners + 1)


def outline(brush: Brush) -> tuple[Point, ...]:
    """The corners of a finished lasso, simplified to at most `MAX_CORNERS`."""
    corners: list[Point] = []
    for point in brush.mark.points:
        if not corners or point != corners[-1]:
            corners.append(point)
    corners = _turning_points(corners)
    while len(corners) > MAX_CORNERS:
        areas = [
            _area(corners[at - 1], point, corners[(at + 1) % len(corners)])
            for at, point in enumerate(corners)
        ]
        del corners[areas.index(min(areas))]  # Visvalingam and Whyatt, 1993
    return tuple(corners)


def _outer_edges(start: Point, end: Point) -> tuple[Point, Point]:
    """Move two cell centres to the outer edges of their cells, so that whole cells are marked."""
    (x0, y0), (x1, y1) = start, end
    across, down = (0.5 if x1 >= x0 else -0.5), (0.5 if y1 >= y0 else -0.5)
    return (x0 - across, y0 - down), (x1 + across, y1 + down)


def _turning_points(points: list[Point]) -> list[Point]:
    if len(points) < 4:
        return points
    return [
        point
        for at, point in enumerate(points)
        if _area(points[at - 1], point, points[(at + 1) % len(points)]) > 1e-12
    ]


def _area(a: Point, b: Point, c: Point) -> float:
    return abs((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]))


def _with_points(brush: Brush, points: tuple[Point, ...]) -> Brush:
    return replace(brush, mark=replace(brush.mark, points=points))


def _shift(panel: PlotArea, point: Point, across: int, down: int) -> Point:
    if panel.shape == "turn":
        return point[0] + TURN_STEP * (across + down), point[1]
    column, row = panel.to_cells(*point)
    if panel.shape == "steps":
        return point[0], panel.to_data(column, row + down)[1]
    return panel.to_data(column + across, row + (down if panel.shape == "plane" else 0))


def _is_on_panel(panel: PlotArea, points: tuple[Point, ...]) -> bool:
    if panel.shape == "turn":
        return True
    cells = [panel.to_cells(*point) for point in points]
    middle = sum(c for c, _ in cells) / len(cells), sum(r for _, r in cells) / len(cells)
    across = panel.x <= middle[0] <= panel.x + panel.width
    return across and panel.y <= middle[1] <= panel.y + panel.height
