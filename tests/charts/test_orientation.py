"""The orientation view: counts, directions and means of headings, and what its dials say."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.analysis.circular import EXACTLY_UP_TO
from s2rtui.canvas import RenderOptions
from s2rtui.canvas.marks import wrap_degrees
from s2rtui.charts.orientation import BINS, orientation_model
from s2rtui.charts.registry import BY_NAME
from s2rtui.drawing.plot import Bars
from s2rtui.export.load_scene import SceneOptions, open_scene
from tests.charts.examples import N, headings, orientation_drawing

COUNT = 30
columns = arrays.arrays(np.float64, COUNT, elements=st.floats(-9, 9) | st.just(np.nan))
masks = arrays.arrays(np.bool_, COUNT)


def one_direction(degrees: float, selected: bool = True):
    """All instances face the same direction."""
    column, ones = np.full(N, math.radians(degrees)), np.ones(N, dtype=np.bool_)
    return orientation_drawing((column, column, column), selected=ones & selected, valid=ones)


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


def test_grey_bars_are_scaled_by_the_selected_share():
    model = orientation_model(headings(), np.arange(N) < 20, np.arange(N) != 3)
    part, whole = (sum(counts.sum() for counts in side) for side in zip(
        *((each.part, each.whole) for each in model.headings.values()), strict=True))  # fmt: skip
    assert model.share == pytest.approx(part / whole)
    for plot in orientation_drawing().plots:
        (bars,) = plot.marks
        assert isinstance(bars, Bars)
        assert bars.whole == pytest.approx(model.headings[plot.name].whole * part / whole)
        assert max(bars.part.max(), bars.whole.max()) <= plot.y.high
    (bars, *_), all_selected = one_direction(10).plots[0].marks, one_direction(10).plots[0]
    assert all_selected.y.high == bars.whole.max() == N


def test_bars_fit_into_the_columns_and_headings_at_the_cursor_are_shown(tiny_store):
    view = BY_NAME["orientation"]
    with open_scene(tiny_store, SceneOptions(run="vanilla", iid=3), view) as scene:
        for width, bins in ((20, 20), (100, 100), (150, 75), (72, 72)):
            assert len(view.drawing(scene, width).plots[0].marks[0].part) == bins
        truth = view.drawing(scene, 72).plots[1].marks[1]
        expected = math.degrees(scene.store.instances.heading[3])
        assert wrap_degrees(truth.x[0] - expected) == pytest.approx(0)
        assert "mean" in "".join(view.draw(scene, (80, 20), RenderOptions()).lines())
