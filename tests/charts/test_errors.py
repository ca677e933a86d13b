"""The error histogram: counts, highlighted bars, medians, the cursor and brushed ranges."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.canvas import DARK, ColourMode, RenderOptions
from s2rtui.canvas.colour import mix
from s2rtui.canvas.marks import BrushShape
from s2rtui.charts.errors import errors_model, errors_plots
from s2rtui.drawing.bars import SOLID
from s2rtui.drawing.cells import draw_cells, drawing_panels
from s2rtui.drawing.drawing import Drawing
from tests.charts.examples import errors_drawing

COUNT = 31
columns = arrays.arrays(np.float64, COUNT, elements=st.floats(0, 20) | st.just(np.nan))
masks = arrays.arrays(np.bool_, COUNT)
SIZE = (72, 13)


@given(columns, columns, masks, masks, st.integers(1, 40))
def test_counts_and_medians_are_those_of_valid_and_selected_instances(
    sim, real, selected, valid, bins
):
    model = errors_model(sim, real, selected, valid, bins)
    upper = model.edges[-1]
    assert (model.edges[0], model.edges.size) == (0, bins + 1)
    for errors, side in ((sim, model.sides["sim"]), (real, model.sides["real"])):
        known = errors[valid & np.isfinite(errors)]
        expected, _ = np.histogram(np.minimum(known, upper), model.edges)
        assert side.whole.sum() == known.size
        assert np.abs(side.whole - expected).max() <= 1  # at an edge both may round differently
        assert side.beyond == (known > upper).sum()
        chosen = errors[selected & valid & np.isfinite(errors)]
        assert side.part.sum() == chosen.size
        assert (side.part <= side.whole).all()
        if chosen.size:
            assert side.median == pytest.approx(float(np.median(chosen)))
        else:
            assert math.isnan(side.median)


def test_large_errors_count_in_the_last_bin_and_the_axis_says_so():
    errors = np.append(np.linspace(0, 1, 200), 99.0)
    ones = np.ones(errors.size, dtype=np.bool_)
    model = errors_model(errors, errors, ones, ones, 4)
    assert model.sides["sim"].beyond == 2
    assert "last bar: 0.995 and more" in errors_plots(model, {})[0].x.names[0]


def test_median_count_and_cursor_are_shown_on_both_sides():
    drawing = errors_drawing(cursor=7)
    canvas = draw_cells(drawing, SIZE)
    for panel, plot in zip(drawing_panels(drawing, SIZE), drawing.plots, strict=True):
        head = canvas.lines()[panel.y - 1]
        assert all(phrase.text in head for phrase in plot.title)
        assert plot.title[2].text == "10 of 60"
        rule, cursor = plot.marks[1:]
        column = int(panel.to_cells(rule.at, 0)[0])
        assert canvas.char[panel.y, column] == "┊"
        column = int(panel.to_cells(float(cursor.x[0]), 0)[0])
        assert canvas.char[panel.y + panel.height - 1, column] == "◉"


def test_bars_are_proportional_to_counts_and_both_sides_share_one_scale():
    errors = np.repeat([0.5, 1.5, 2.99, 0.1, 0.2], [8, 4, 1, 7, 7])
    ones = np.ones(errors.size, dtype=np.bool_)
    model = errors_model(errors, errors, ones, ones, 30)
    drawing = Drawing(errors_plots(model, {}))
    assert {plot.y.high for plot in drawing.plots} == {8.0}
    canvas = draw_cells(drawing, (34, 13))
    panel, _ = drawing_panels(drawing, (34, 13))
    column = panel.x + int(0.5 / model.edges[-1] * panel.width)
    assert (canvas.char[panel.y : panel.y + panel.height, column] == "█").all()
    half = panel.x + int(1.5 / model.edges[-1] * panel.width)
    inked = np.count_nonzero(canvas.char[panel.y : panel.y + panel.height, half] != " ")
    assert inked == math.ceil(panel.height / 2)


def test_selected_bars_are_coloured_and_others_grey():
    canvas = draw_cells(errors_drawing(), (60, 12))
    colours = {tuple(colour.tolist()) for colour in canvas.fg[canvas.char != " "]}
    grey = tuple(mix(DARK.background, DARK.unselected, SOLID).tolist())
    assert {DARK.sim, DARK.real, grey} <= colours


def test_a_pending_range_is_marked_only_on_its_side():
    drawing = errors_drawing(brush=BrushShape("real", ((1.0, 0.0), (2.0, 0.0))))
    canvas = draw_cells(drawing, SIZE, RenderOptions(mode=ColourMode.PALETTE))
    sim, real = drawing_panels(drawing, SIZE)
    first, last = (int(real.to_cells(x, 0)[0]) for x in (1.0, 2.0))
    assert (canvas.char[real.y, first], canvas.char[real.y, last]) == ("├", "┤")
    ground = (canvas.bg == DARK.highlight).all(axis=-1)
    assert ground[real.y, first : last + 1].all()
    assert not ground[sim.y : sim.y + sim.height].any()
