"""The error histogram: counts, highlighted bars and medians."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.canvas import DARK, ColourMode, RenderOptions
from s2rtui.canvas.colour import mix
from s2rtui.canvas.marks import Mark
from s2rtui.charts.errors.model import errors_model
from s2rtui.charts.errors.terminal import draw_errors, errors_panels
from s2rtui.charts.shared.bars import SOLID
from s2rtui.drawing.scale import short_number
from tests.charts.examples import N, errors_input

SIZE = 31
columns = arrays.arrays(np.float64, SIZE, elements=st.floats(0, 20) | st.just(np.nan))
masks = arrays.arrays(np.bool_, SIZE)
PALETTE = RenderOptions(mode=ColourMode.PALETTE)


def test_valid_and_selected_instances_are_counted():
    view = errors_input(valid=np.arange(N) != 0)
    model = errors_model(view, 12)
    assert model.sim.total.sum() == N - 1
    assert model.real.highlighted.sum() == 9
    assert (model.sim.highlighted <= model.sim.total).all()
    assert model.edges[0] == 0
    for side, errors in ((view.sim, model.sim), (view.real, model.real)):
        expected, _ = np.histogram(np.minimum(side[1:], model.upper), model.edges)
        np.testing.assert_array_equal(errors.total, expected)


def test_large_errors_count_in_the_last_bin_and_nan_in_none():
    errors = np.array([0.5, 99.0, np.nan])
    ones = np.ones(3, dtype=np.bool_)
    view = errors_input(sim=errors, real=errors, selected=ones, valid=ones, upper=1.0)
    model = errors_model(view, 2)
    assert model.sim.total.tolist() == [0, 2]
    assert model.sim.beyond == 1


@pytest.mark.parametrize("median", [0.0184, 123456.0])
def test_the_number_of_a_median_is_never_cut(median):
    everything = np.ones(4, dtype=np.bool_)
    errors = np.full(4, median)
    view = errors_input(
        sim=errors, real=errors, selected=everything, valid=everything, upper=2 * median
    )
    for columns in range(24, 40):
        line = draw_errors(view, (columns, 11)).lines()[1]
        assert f"median {short_number(median, 2)} " in line


@given(columns, columns, masks, masks, st.integers(1, 40))
def test_medians_are_those_of_selected_instances(sim, real, selected, valid, count):
    view = errors_input(sim=sim, real=real, selected=selected, valid=valid, upper=5.0)
    model = errors_model(view, count)
    for column, errors in ((sim, model.sim), (real, model.real)):
        selected_errors = column[selected & valid & np.isfinite(column)]
        if selected_errors.size:
            assert errors.median == pytest.approx(float(np.median(selected_errors)))
        else:
            assert math.isnan(errors.median)


def test_the_median_is_written_and_marked_on_both_sides():
    view = errors_input(upper=4.0)
    canvas = draw_errors(view, (72, 11))
    lines = canvas.lines()
    for panel, column in zip(errors_panels(view, (72, 11)), (view.sim, view.real), strict=True):
        median = float(np.median(column[:10]))
        column_at = int(panel.to_cells(median, 0)[0])
        assert canvas.char[panel.y, column_at] == "┊"
        assert f"median {median:.2g}" in lines[panel.y + 1]


def test_the_cursor_is_marked_in_its_bin_on_each_side():
    view = errors_input(cursor=7, upper=6.0)
    canvas = draw_errors(view, (72, 11))
    for panel, column in zip(errors_panels(view, (72, 11)), (view.sim, view.real), strict=True):
        column_at = int(panel.to_cells(float(column[7]), 0)[0])
        assert canvas.char[panel.y + panel.height - 1, column_at] == "◉"
    invalid = errors_input(cursor=0, valid=np.arange(N) != 0)
    assert "◉" not in "".join(draw_errors(invalid, (72, 11)).lines())


def test_bar_heights_are_proportional_to_counts():
    errors = np.repeat([0.5, 1.5, 2.5], [8, 4, 1])
    ones = np.ones(errors.size, dtype=np.bool_)
    view = errors_input(sim=errors, real=errors, selected=ones, valid=ones, upper=3.0)
    canvas = draw_errors(view, (3, 4))
    assert canvas.char[:2, 1:].tolist() == [[" ", " "], ["█", "▂"]]


def test_selected_bars_are_coloured_and_others_grey():
    canvas = draw_errors(errors_input(), (60, 12))
    inked = canvas.char[:, 12:] != " "
    colours = {tuple(colour.tolist()) for colour in canvas.fg[:, 12:][inked]}
    assert {DARK.sim, DARK.real} <= colours
    grey = tuple(mix(DARK.background, DARK.unselected, SOLID).tolist())
    assert grey in colours


def test_a_pending_range_is_marked_only_on_its_side():
    view = errors_input(mark=Mark("real", ((1.0, 0.0), (2.0, 0.0))), upper=6.0)
    canvas = draw_errors(view, (72, 11), PALETTE)
    sim, real = errors_panels(view, (72, 11))
    first, last = (int(real.to_cells(x, 0)[0]) for x in (1.0, 2.0))
    row = real.y
    assert canvas.char[row, first] == "├"
    assert canvas.char[row, last] == "┤"
    ground = (canvas.bg == DARK.highlight).all(axis=-1)
    assert ground[row, first : last + 1].all()
    assert not ground[sim.y : sim.y + sim.height].any()


def test_both_sides_share_one_scale_of_counts():
    ones = np.ones(30, dtype=np.bool_)
    real = np.repeat([0.5, 1.5, 2.5], 10)
    view = errors_input(sim=np.full(30, 0.5), real=real, selected=ones, valid=ones, upper=3.0)
    assert errors_model(view, 3).peak == 30
    panels = errors_panels(view, (3, 4))
    assert [panel.to_data(0, panel.y)[1] for panel in panels] == [30.0, 30.0]
    canvas = draw_errors(view, (3, 4))
    assert canvas.char[2:, ::2].tolist() == [[" ", " "], ["▆", "▆"]]
