"""Brushing by keys and by mouse: a mark on a panel, moved, stretched, and turned into a selection.

Marks live in data coordinates and are moved by cells; a `turn` moves by its 5 degree bins.
"""

from __future__ import annotations

from dataclasses import replace

from s2rtui.canvas.brush import Mark, Panel, Point
from s2rtui.session.state import Brush

TURN_STEP = 5.0
MOST_CORNERS = 64
"""Of a lasso in the language."""
_SHARE = 0.12
"""Half of a new box, as a share of its panel."""


def begun(view: str, panel: Panel, at: Point | None, lasso: bool = False) -> Brush:
    """A brush about a point in data (default: the panel's middle)."""
    column, row = _middle(panel) if at is None else panel.to_cells(*at)
    column = min(max(column, panel.x + 0.5), panel.x + panel.width - 0.5)
    row = min(max(row, panel.y + 0.5), panel.y + panel.height - 0.5)
    centre = panel.to_data(column, row) if at is None else at
    if panel.shape == "steps":
        return Brush(view, Mark(panel.name, (centre, centre)))
    if panel.shape == "turn":
        low, high = centre[0] - 2 * TURN_STEP, centre[0] + 2 * TURN_STEP
        return Brush(view, Mark(panel.name, ((low, centre[1]), (high, centre[1]))))
    if lasso and panel.shape == "plane":
        return Brush(view, Mark(panel.name, (panel.to_data(column, row),), lasso=True))
    wide, high_ = max(1.0, _SHARE * panel.width), max(1.0, _SHARE * panel.height)
    corners = (panel.to_data(column - wide, row - high_), panel.to_data(column + wide, row + high_))
    return Brush(view, Mark(panel.name, corners))


def dragged(view: str, panel: Panel, start: Point, end: Point, trail: tuple[Point, ...]) -> Brush:
    """A brush between two cells (column, row), or along a trail of cells: a lasso."""
    if trail and panel.shape == "plane":
        points = tuple(panel.to_data(*cell) for cell in trail)
        return Brush(view, Mark(panel.name, points, lasso=True), len(points))
    if panel.shape in ("plane", "range"):
        start, end = _outer(start, end)
    points = panel.to_data(*start), panel.to_data(*end)
    if panel.shape == "turn" and (points[1][0] - points[0][0]) % 360 > 180:
        points = points[1], points[0]  # dragged backwards: the shorter way round is meant
    return Brush(view, Mark(panel.name, points))


def moved(brush: Brush, panel: Panel, across: int, down: int) -> Brush:
    """All of a box by cells, or the loose end of a lasso."""
    points = brush.mark.points
    if brush.mark.lasso:
        return _with(brush, (*points[:-1], _shifted(panel, points[-1], across, down)))
    shifted = tuple(_shifted(panel, point, across, down) for point in points)
    return _with(brush, shifted) if _inside(panel, shifted) else brush


def stretched(brush: Brush, panel: Panel, across: int, down: int) -> Brush:
    """The second corner by cells."""
    if brush.mark.lasso:
        return moved(brush, panel, across, down)
    first, *_, last = brush.mark.points
    end = _shifted(panel, last, across, down)
    wide = (last[0] - first[0]) % 360 + end[0] - last[0]
    if panel.shape == "turn" and not TURN_STEP <= wide < 360:
        return brush
    return _with(brush, (first, end))


def scaled(brush: Brush, panel: Panel, steps: int) -> Brush:
    """Larger (steps > 0) or smaller on every side; never turned inside out."""
    if brush.mark.lasso:
        return brush
    first, *_, last = brush.mark.points
    if panel.shape == "turn":
        low, high = first[0] - steps * TURN_STEP, last[0] + steps * TURN_STEP
        keeps = TURN_STEP <= high - low < 360
        return _with(brush, ((low, first[1]), (high, last[1]))) if keeps else brush
    ends = [panel.to_cells(*point) for point in (first, last)]
    (x0, y0), (x1, y1) = ends
    grow = 0 if panel.shape == "steps" else steps
    tall = 0 if panel.shape == "range" else steps
    sign_x, sign_y = (1 if x1 >= x0 else -1), (1 if y1 >= y0 else -1)
    corners = (x0 - sign_x * grow, y0 - sign_y * tall), (x1 + sign_x * grow, y1 + sign_y * tall)
    if (corners[1][0] - corners[0][0]) * sign_x < 0 or (corners[1][1] - corners[0][1]) * sign_y < 0:
        return brush
    return _with(brush, tuple(panel.to_data(*corner) for corner in corners))


def cornered(brush: Brush) -> Brush:
    """The loose end of a lasso becomes a corner, and a new loose end starts there."""
    points = brush.mark.points
    return replace(_with(brush, (*points, points[-1])), corners=brush.corners + 1)


def outline(brush: Brush) -> tuple[Point, ...]:
    """The corners of a finished lasso, at most as many as the language takes."""
    kept: list[Point] = []
    for point in brush.mark.points:
        if not kept or point != kept[-1]:
            kept.append(point)
    kept = _bends(kept)
    while len(kept) > MOST_CORNERS:
        areas = [
            _area(kept[at - 1], point, kept[(at + 1) % len(kept)]) for at, point in enumerate(kept)
        ]
        del kept[areas.index(min(areas))]  # Visvalingam and Whyatt, 1993
    return tuple(kept)


def _outer(start: Point, end: Point) -> tuple[Point, Point]:
    """Two middles of cells moved to the far edges of those cells: all that is marked counts."""
    (x0, y0), (x1, y1) = start, end
    across, down = (0.5 if x1 >= x0 else -0.5), (0.5 if y1 >= y0 else -0.5)
    return (x0 - across, y0 - down), (x1 + across, y1 + down)


def _bends(points: list[Point]) -> list[Point]:
    """The points of a closed line where it changes its direction."""
    if len(points) < 4:
        return points
    return [
        point
        for at, point in enumerate(points)
        if _area(points[at - 1], point, points[(at + 1) % len(points)]) > 1e-12
    ]


def _area(a: Point, b: Point, c: Point) -> float:
    """Of a triangle, doubled."""
    return abs((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]))


def _with(brush: Brush, points: tuple[Point, ...]) -> Brush:
    return replace(brush, mark=replace(brush.mark, points=points))


def _middle(panel: Panel) -> Point:
    return panel.x + panel.width / 2, panel.y + panel.height / 2


def _shifted(panel: Panel, point: Point, across: int, down: int) -> Point:
    if panel.shape == "turn":
        return point[0] + TURN_STEP * (across + down), point[1]
    if panel.shape == "steps":
        column, row = panel.to_cells(*point)
        stepped = panel.to_data(column, row + down)
        return point[0], stepped[1]
    column, row = panel.to_cells(*point)
    return panel.to_data(column + across, row + (down if panel.shape == "plane" else 0))


def _inside(panel: Panel, points: tuple[Point, ...]) -> bool:
    """Whether some of a moved mark is still on its panel."""
    if panel.shape == "turn":
        return True
    cells = [panel.to_cells(*point) for point in points]
    middle = sum(c for c, _ in cells) / len(cells), sum(r for _, r in cells) / len(cells)
    across = panel.x <= middle[0] <= panel.x + panel.width
    return across and panel.y <= middle[1] <= panel.y + panel.height
