"""The orientation view: counts, directions and means of headings."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.canvas.marks import wrap_degrees
from s2rtui.charts.orientation import BINS, EXACTLY_UP_TO, orientation_model

COUNT = 30
columns = arrays.arrays(np.float64, COUNT, elements=st.floats(-9, 9) | st.just(np.nan))
masks = arrays.arrays(np.bool_, COUNT)


@given(columns, masks, masks, st.sampled_from([BINS, 30, 1]))
def test_counts_and_means_are_those_of_selected_instances(column, selected, valid, bins):
    model = orientation_model((column, column, column), selected, valid, bins)
    one = model.headings["sim"]
    for mask, counts in ((selected & valid, one.part), (valid, one.whole)):
        known = column[mask & np.isfinite(column)]
        wrapped = np.array([wrap_degrees(degrees) for degrees in np.degrees(known)])
        expected, _ = np.histogram(wrapped, model.edges)
        assert counts.sum() == known.size
        on_edge = np.abs(wrapped[:, None] - model.edges).min(initial=np.inf) < 1e-9
        apart = np.abs(np.cumsum(counts) - np.cumsum(expected)).max(initial=0)
        assert apart <= on_edge * known.size
    known = column[selected & valid & np.isfinite(column)]
    if known.size:
        vector = np.exp(1j * known).mean()
        assert one.resultant == pytest.approx(abs(vector), abs=1e-12)
        if abs(vector) > 1e-6:
            difference = wrap_degrees(one.mean - math.degrees(np.angle(vector)))
            assert difference == pytest.approx(0, abs=1e-6)
    else:
        assert math.isnan(one.mean)


@pytest.mark.parametrize("bins", [BINS, 20])
def test_means_of_many_instances_are_accurate(bins):
    random = np.random.default_rng(3)
    number = 4 * EXACTLY_UP_TO
    ones = np.ones(number, dtype=np.bool_)
    selected = random.random(number) < 0.6
    spread = random.vonmises(1.0, 2.0, number)
    grid = np.radians(random.choice([0.0, 90.0, 91.0], number))
    model = orientation_model((spread, grid, grid), selected, ones, bins)
    for name, column in (("sim", spread), ("truth", grid)):
        vector = np.exp(1j * column[selected]).mean()
        found = model.headings[name]
        assert found.mean == pytest.approx(math.degrees(np.angle(vector)), abs=0.1)
        assert found.resultant == pytest.approx(abs(vector), abs=1e-3)
