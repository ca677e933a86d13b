"""The error histogram: counts, medians and colours of bars."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.canvas import DARK
from s2rtui.canvas.colour import mix
from s2rtui.charts.errors import errors_model
from s2rtui.drawing.bars import SOLID
from s2rtui.drawing.cells import draw_cells
from tests.charts.examples import errors_drawing

COUNT = 31
columns = arrays.arrays(np.float64, COUNT, elements=st.floats(0, 20) | st.just(np.nan))
masks = arrays.arrays(np.bool_, COUNT)


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


def test_selected_bars_are_coloured_and_others_grey():
    canvas = draw_cells(errors_drawing(), (60, 12))
    colours = {tuple(colour.tolist()) for colour in canvas.fg[canvas.char != " "]}
    grey = tuple(mix(DARK.background, DARK.unselected, SOLID).tolist())
    assert {DARK.sim, DARK.real, grey} <= colours
