"""Scales invert, labels do not collide, and the renderers show every part of a drawing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rtui.canvas import DARK
from s2rtui.canvas.marks import BrushShape
from s2rtui.drawing.cells import draw_cells
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.plot import Line, Plot
from s2rtui.drawing.scale import Scale
from tests.drawing import examples

scales = st.builds(
    lambda low, span, log: Scale(low, low + span, log=log),
    st.floats(0.01, 100), st.floats(0.1, 1000), st.booleans(),
)  # fmt: skip


@given(scales, st.floats(0, 1))
def test_places_and_values_are_inverse(scale, place):
    value = float(scale.value(place))
    assert scale.low - 1e-6 <= value <= scale.high + 1e-6
    assert float(scale.fraction(value)) == pytest.approx(place, abs=1e-6)


@given(scales, st.integers(8, 120), st.integers(1, 20))
def test_labels_keep_apart_and_stay_within_the_axis(scale, length, most):
    free = 0.0
    for start, tick, text in scale.labels(length, most, len, 1.0):
        assert start >= free - 1e-9
        assert 0 <= tick <= length
        free = start + len(text) + 1
    assert free <= length + 1


def test_a_drawing_shows_its_plot_table_and_notes():
    drawing = examples.drawing()
    lines = draw_cells(drawing, (80, 24)).lines()
    assert lines[0].split() == ["◆", "sim", "-", "-", "best", "mean", "error", "(m)"]
    assert any("position error of the instances (m)" in line for line in lines)
    assert any("0.25 m (0.10 to 0.90)" in line for line in lines)
    assert [line.strip() for line in lines[-2:]] == list(drawing.notes)
    assert drawing.text.startswith("row 0: sim 0.25 m (0.10 to 0.90). row 1:")


def test_details_and_rows_without_room_are_left_out_and_said_to_be():
    lines = draw_cells(examples.drawing(), (24, 18)).lines()
    assert not any("(0.10" in line for line in lines)
    assert any("3.25 m" in line for line in lines)
    drawing = examples.drawing()
    longer = replace(drawing, table=replace(drawing.table, rows=drawing.table.rows * 3))
    crowded = draw_cells(longer, (40, 18)).lines()
    assert any("/12" in line for line in crowded)


def test_terminals_with_graphics_get_plots_in_true_pixels_while_nothing_is_brushed():
    drawing = examples.drawing()
    canvas = draw_cells(drawing, (80, 24))
    (image,) = canvas.images
    pixels = image.pixels((200, 640))
    assert (pixels.shape, pixels.dtype) == ((200, 640, 3), np.uint8)
    for colour in (DARK.sim, DARK.real):
        assert (np.abs(pixels.astype(int) - colour).max(axis=2) <= 8).any()
    assert draw_cells(drawing, (80, 24)).images[0].content_key == image.content_key
    brushed = replace(drawing, brush=BrushShape("", ((1.0, 0.0), (2.0, 0.0))))
    assert not draw_cells(brushed, (80, 24)).images


def test_a_line_is_drawn_only_where_it_lies_within_the_scale_of_y():
    low, high = (Scale(0, 10, (name,)) for name in ("a (m)", "b (m)"))
    rising = Line(np.array([0.0, 10.0]), np.array([-10.0, 10.0]), "sim")
    plain, bent = (
        draw_cells(Drawing(plots=(Plot(low, high, marks),)), (60, 20))
        for marks in ((), (rising,))
    )  # fmt: skip
    rows, columns = np.nonzero(plain.char != bent.char)
    assert columns.min() > 30  # it is below the scale in the left half
    assert 0 <= rows.min() < 3
