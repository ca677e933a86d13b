"""Brush marks as expressions of the selection language."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from s2rstore.geometry import angles
from s2rstore.language.canonical_text import quoted
from s2rtui.canvas import BrushShape, PlotArea, Point
from s2rtui.drawing.scale import Floats, Scale
from s2rtui.session.brush_geometry import MAX_CORNERS

_EDGE = 1e-9
_DIGITS = 17


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


def box_expression(
    axis: Scale, sim: Floats, real: Floats, mark: BrushShape, cell: tuple[float, float]
) -> str:
    """Ranges of both errors, with the shortest numbers that select what the box covers.

    Errors are (N,); `cell` is the size of a cell as fractions of the axes. An end of the box that
    lies on the edge of the plot, or beyond it, sets no limit. A box below all errors of a side is
    `none`.
    """
    parts = []
    for side, errors, place, width in zip(("sim", "real"), (sim, real), (0, 1), cell, strict=True):
        ends = sorted(point[place] for point in (mark.points[0], mark.points[-1]))
        fractions = axis.fraction([max(end, 1e-300) if axis.log else end for end in ends])
        low = None if fractions[0] <= _EDGE else _shortest(errors, ends[0], axis, width)
        high = None
        if fractions[1] < 1 - _EDGE:
            if not (np.asarray(errors) < ends[1]).any():
                return "none"
            high = _shortest(errors, ends[1], axis, width, True)
        parts.append(_range(f"{side}.error", low, high))
    return " & ".join(part for part in parts if part) or "all"


def lasso_expression(axis: Scale, mark: BrushShape, cell: tuple[float, float]) -> str:
    """A polygon in metres.

    Edges that are straight on logarithmic axes are curves in metres: they get as many corners as
    the language allows.
    """
    corners = list(mark.points)
    if axis.log:
        corners = _divided(axis, corners, MAX_CORNERS // len(corners))
    numbers = []
    for corner in corners:
        for error, width in zip(corner, cell, strict=True):
            place = float(axis.fraction(max(error, 1e-300) if axis.log else error))
            step = _step(axis, place, width)
            numbers.append(0.0 if place <= _EDGE else round_to_cell(error, step / 10))
    return function_call("error.lasso", numbers)


def _divided(axis: Scale, corners: list[Point], parts: int) -> list[Point]:
    """The polygon with each edge in `parts` pieces that are equal on the axes."""
    places = np.maximum(axis.fraction(np.maximum(np.array(corners), 1e-300)), 0.0)
    along = np.arange(parts)[:, None] / parts
    pieces = [
        first + along * (second - first)
        for first, second in zip(places, np.roll(places, -1, axis=0), strict=True)
    ]
    return [(float(x), float(y)) for x, y in axis.value(np.concatenate(pieces))]


def _step(axis: Scale, place: float, width: float) -> float:
    """The difference of the values at both ends of a cell that is `width` of the axis wide."""
    return abs(float(axis.value(place + width) - axis.value(place)))


def _shortest(errors: Floats, end: float, axis: Scale, width: float, upper: bool = False) -> float:
    """The shortest number that divides the errors as `end` does, at the precision of a cell.

    Errors below `end` are on one side, the others on the other. An `upper` limit belongs to the
    lower side, a lower limit to the upper one, because ranges of the language include both ends.
    """
    known = np.asarray(errors, dtype=np.float64)
    is_below = known < end
    below = known[is_below].max(initial=-math.inf)
    above = known[(known >= end)].min(initial=math.inf)
    place = float(axis.fraction(end))
    step = _step(axis, place, width)
    first = max(0, math.ceil(-math.log10(step))) if step else _DIGITS
    for digits in range(first, _DIGITS):
        number = float(number_text(round(end, digits)))
        if below <= number < above if upper else below < number <= above:
            return number
    return float(below if upper else above)


def _range(field: str, low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return f"{field}:{_text(low)}..{_text(high)}"
    if low is not None:
        return f"{field} >= {_text(low)}"
    return "" if high is None else f"{field} <= {_text(high)}"


def _text(value: float) -> str:
    """A number that the language reads as exactly this value."""
    text = number_text(value)
    return text if float(text) == value else repr(value)
