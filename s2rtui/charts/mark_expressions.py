"""Brush marks as expressions of the selection language."""

from __future__ import annotations

import math
from collections.abc import Sequence

from s2rstore.geometry import angles
from s2rstore.language.canonical_text import quoted
from s2rtui.canvas import BrushShape, PlotArea


def round_to_cell(value: float, cell: float) -> float:
    """Round a coordinate to the precision of a cell that is `cell` units wide."""
    places = max(0, math.ceil(-math.log10(max(abs(cell), 1e-9))) + 1)
    return round(value, places)


def area_expression(panel: PlotArea, mark: BrushShape, box: str, lasso: str) -> str:
    """A call of the `box` or `lasso` function with the corners of a mark."""
    first, second = panel.to_data(0, 0), panel.to_data(1, 1)
    wide, high = second[0] - first[0], second[1] - first[1]
    points = [(round_to_cell(x, wide), round_to_cell(y, high)) for x, y in mark.points]
    if mark.lasso:
        return function_call(lasso, [number_text for point in points for number_text in point])
    (x0, y0), (x1, y1) = points[0], points[-1]
    return function_call(box, [min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)])


def range_expression(
    panel: PlotArea,
    mark: BrushShape,
    field: str,
    lowest: float = -math.inf,
    highest: float = math.inf,
) -> str:
    """A range of a field, both ends included, limited to the field's possible values."""
    cell = cell_width(panel)
    ends = sorted(
        min(max(round_to_cell(point[0], cell), lowest), highest)
        for point in (mark.points[0], mark.points[-1])
    )
    return f"{field}:{number_text(ends[0])}..{number_text(ends[1])}"


def cell_width(panel: PlotArea) -> float:
    """The width of one column of the panel in data units."""
    left = panel.x + min(1, panel.width - 1)
    return panel.to_data(left + 1, panel.y)[0] - panel.to_data(left, panel.y)[0]


def heading_expression(mark: BrushShape, field: str) -> str:
    """A range of a heading in degrees, from the first point of a mark to the last."""
    low, high = (round(point[0]) for point in (mark.points[0], mark.points[-1]))
    if high - low >= 360:
        low, high = -180, 180
    return f"{field}:{number_text(_heading(low))}..{number_text(_heading(high))}"


def names_expression(mark: BrushShape, field: str, names: Sequence[str]) -> str:
    """One or several names of a text field; rows without a name are left out."""
    rows = sorted(round(point[1]) for point in (mark.points[0], mark.points[-1]))
    selection = [names[row] for row in range(max(0, rows[0]), min(len(names), rows[1] + 1))]
    return " | ".join(f"{field}:{quoted(name)}" for name in selection) or "none"


def function_call(function: str, numbers: Sequence[float]) -> str:
    """A call as the selection language writes it."""
    return f"{function}({', '.join(number_text(value) for value in numbers)})"


def number_text(value: float) -> str:
    """A number as the selection language writes it."""
    return str(int(value)) if value == int(value) else f"{value:.10g}"


def _heading(degrees: float) -> float:
    return angles.wrap_degrees(degrees) if abs(degrees) != 180 else degrees
