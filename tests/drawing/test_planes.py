"""Planes: scales in both directions, poses, names, the scale bar, and their shape on pages."""

import numpy as np
import pytest

from s2rstore.records import Room
from s2rtui.canvas import Canvas, RenderOptions
from s2rtui.drawing.cells import draw_cells
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.drawing_layout import drawing_layout, y_labels
from s2rtui.drawing.plane_marks import Outlines, PlaneMark, Poses, ScaleBar, Unselected
from s2rtui.drawing.plot import Plot
from s2rtui.drawing.plot_cells import draw_marks
from s2rtui.drawing.scale import Scale, short_number

OPTIONS = RenderOptions()
X, UP, DOWN = Scale(0.0, 40.0, ("x m",)), Scale(0.0, 20.0, ("y m",)), Scale(20.0, 0.0, ("y m",))


def plane(*marks: PlaneMark, y: Scale = DOWN) -> Plot:
    return Plot(X, y, marks, "map", shape="plane", equal=True)


@pytest.mark.parametrize("y", [UP, DOWN])
def test_labels_and_equal_scales_follow_the_direction_of_y(y):
    labels = y_labels(plane(y=y), 20)
    rows = sorted(labels, key=lambda row: float(labels[row]))
    assert len(rows) > 3
    assert rows == sorted(rows, reverse=y is UP)
    fitted = plane(y=y).fitted(80, 80)
    assert (fitted.y.low, fitted.y.high) == ((-10, 30) if y is UP else (30, -10))
    assert plane(y=y).tight(8.0, 8.0) == (8.0, 4.0)


def drawn(mark: PlaneMark, y: Scale = DOWN, *others: PlaneMark) -> Canvas:
    """The marks in cells of one metre by two."""
    canvas = Canvas(40, 10, OPTIONS)
    draw_marks(canvas, plane(*others, mark, y=y))
    return canvas


@pytest.mark.parametrize(("y", "row", "arrow"), [(UP, 7, "↑"), (DOWN, 2, "↓")])
def test_poses_point_in_the_direction_of_their_heading(y, row, arrow):
    (pose,) = (((10.5, 5.0, np.pi / 2),),)
    canvas = drawn(Poses(pose, "cursor", "cursor"), y)
    assert canvas.char[row, 10] == "◉"
    assert canvas.char[row + (1 if y is DOWN else -1), 10] == arrow
    assert drawn(Poses(pose, "planned"), y).char[row, 10] == arrow
    assert (drawn(Poses(((99.0, 5.0, None),), "planned"), y).char == " ").all()


def test_a_name_is_where_it_covers_the_fewest_marks():
    room = Outlines((Room("office", 0, 0.0, 0.0, 40.0, 20.0),))
    x, y = np.arange(2.0, 38.0), np.full(36, 9.0)
    nobody, everyone = np.zeros(36, dtype=np.bool_), np.ones(36, dtype=np.bool_)
    empty = drawn(room).lines()
    assert "office" in empty[4] or "office" in empty[5]
    lines = drawn(room, DOWN, Unselected(x, y, nobody, everyone)).lines()
    (row,) = (place for place, line in enumerate(lines) if "office" in line)
    assert row != 4
    assert sum(0x2800 < ord(glyph) <= 0x28FF for glyph in lines[4]) >= 36
    narrow = Outlines((Room("laboratory", 0, 10.0, 0.0, 16.0, 20.0),))
    assert any("labor…" in line for line in drawn(narrow).lines())


@pytest.mark.parametrize("size", [(30, 10), (60, 20), (120, 30), (120, 60)])
def test_the_scale_bar_is_as_long_as_it_says(size):
    drawing = Drawing((plane(ScaleBar()),), notes=((),))
    plot = drawing_layout(drawing, size, OPTIONS).plots[0].plot
    (line,) = (line for line in draw_cells(drawing, size).lines() if "├" in line)
    cells = line.index("┤") - line.index("├") + 1
    metres = float(line.split("┤")[1].split()[0])
    width = drawing_layout(drawing, size, OPTIONS).plots[0].width
    assert cells == pytest.approx(metres / ((plot.x.high - plot.x.low) / width), abs=0.51)
    assert short_number(metres)[0] in "125"
