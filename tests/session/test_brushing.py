"""Geometry of brushes: start, movement, scaling and stretching on panels."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.language import parse
from s2rtui.canvas.marks import BrushShape, PlotArea
from s2rtui.charts.mark_expressions import range_expression
from s2rtui.session import brush_geometry
from s2rtui.session.state import Brush


def plane(y_down: bool = True) -> PlotArea:
    """A panel of 10 x 8 cells at (5, 2); a cell is 0.5 m wide and 1 m high."""
    sign = 1 if y_down else -1
    return PlotArea(
        "map", "plane", 5, 2, 10, 8,
        lambda column, row: ((column - 5) * 0.5, sign * (row - 2)),
        lambda x, y: (x / 0.5 + 5, sign * y + 2),
    )  # fmt: skip


def line(shape: str) -> PlotArea:
    return PlotArea(
        "real", shape, 0, 0, 20, 10, lambda c, r: (c * 0.1, r), lambda x, y: (x * 10, y)
    )


@given(st.lists(st.tuples(st.integers(-3, 3), st.integers(-3, 3)), max_size=12))
def test_moving_keeps_the_size_and_stays_on_the_panel(steps):
    panel = plane()
    brush = brush_geometry.started("map", panel, None)
    (x0, y0), (x1, y1) = brush.mark.points
    for step in steps:
        brush = brush_geometry.moved(brush, panel, *step)
    (u0, v0), (u1, v1) = brush.mark.points
    assert u1 - u0 == pytest.approx(x1 - x0)
    assert v1 - v0 == pytest.approx(y1 - y0)
    column, row = panel.to_cells((u0 + u1) / 2, (v0 + v1) / 2)
    assert 5 <= column <= 15
    assert 2 <= row <= 10


@given(st.lists(st.sampled_from([-1, 1]), max_size=20))
@pytest.mark.parametrize("shape", ["plane", "range", "turn", "steps"])
def test_scaling_keeps_a_mark_positive(shape, steps):
    panel = plane() if shape == "plane" else line(shape)
    brush = brush_geometry.started("map", panel, None)
    for step in steps:
        brush = brush_geometry.scaled(brush, panel, step)
        (x0, y0), (x1, y1) = brush.mark.points
        assert x1 >= x0
        assert y1 >= y0
        assert x1 - x0 <= 360 or shape != "turn"


def test_marks_of_headings_and_rooms_move_by_their_steps():
    brush = brush_geometry.started("orientation", line("turn"), (90.0, 1.0))
    moved = brush_geometry.moved(brush, line("turn"), 1, 0)
    assert [x for x, _ in moved.mark.points] == [85.0, 105.0]
    brush = brush_geometry.started("rooms", line("steps"), (0.0, 3.0))
    moved = brush_geometry.moved(brush, line("steps"), 4, 1)
    moved = brush_geometry.stretched(moved, line("steps"), 0, 2)
    assert [y for _, y in moved.mark.points] == [4.0, 6.0]


def test_a_lasso_grows_corner_by_corner_and_is_not_scaled():
    panel = plane()
    brush = brush_geometry.started("map", panel, (1.0, 1.0), lasso=True)
    for step in ((2, 0), (0, 2), (-2, 0)):
        brush = brush_geometry.moved(brush_geometry.with_corner(brush), panel, *step)
    assert brush.corners == 3
    assert brush_geometry.outline(brush) == ((1.0, 1.0), (2.0, 1.0), (2.0, 3.0), (1.0, 3.0))
    assert brush_geometry.scaled(brush, panel, 1) == brush


@given(st.lists(st.tuples(st.integers(-1, 1), st.integers(-1, 1)), max_size=90))
def test_a_stretched_heading_mark_keeps_its_direction(steps):
    panel = line("turn")
    brush = brush_geometry.started("orientation", panel, (0.0, 1.0))
    start = brush.mark.points[0]
    for step in steps:
        brush = brush_geometry.stretched(brush, panel, *step)
        assert brush.mark.points[0] == start
        assert brush_geometry.TURN_STEP <= brush.mark.points[1][0] - start[0] < 360


def test_a_heading_mark_across_180_degrees_can_be_stretched():
    panel = line("turn")
    drawn = replace(
        brush_geometry.started("orientation", panel, None).mark, points=((170, 1), (-170, 1))
    )
    brush = brush_geometry.stretched(Brush("orientation", drawn), panel, 1, 0)
    assert brush.mark.points == ((170, 1), (-165, 1))


@given(st.floats(-3, 3), st.floats(-3, 3))
def test_a_range_is_clipped_to_the_limits_of_its_field(low, high):
    panel = line("range")
    mark = BrushShape("real", ((low, 0.0), (high, 0.0)))
    text = range_expression(panel, mark, "real.accuracy", 0.0, 1.0)
    first, last = text.removeprefix("real.accuracy:").split("..")
    assert 0 <= float(first) <= float(last) <= 1
    parse(text)
