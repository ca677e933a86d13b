"""The UMAP view: colours by distance and missing coordinates."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.charts.umap import distance_levels, distance_range, distances
from s2rtui.drawing.cells import draw_cells
from s2rtui.drawing.plot import LEVELS
from tests.charts.examples import N, umap_drawing, umap_points

SIZE = (60, 14)
values = arrays.arrays(np.float64, 25, elements=st.floats(-1, 5) | st.just(np.nan))


@given(values)
def test_levels_divide_the_range_of_the_values(values):
    levels = distance_levels(values, (0.0, 4.0))
    known = np.isfinite(values)
    assert (levels[~known] == 0).all()
    share = np.clip(values[known], 0.0, 4.0) / 4.0
    assert np.abs((levels[known] - 0.5) / LEVELS - share).max(initial=0) <= 0.501 / LEVELS


def test_colours_show_the_distance_of_both_sides():
    sim, real = umap_points().values()
    apart = np.hypot(*(sim - real).T)
    np.testing.assert_array_equal(distances(*sim.T, *real.T), apart)
    known = apart[np.isfinite(apart)]
    assert distance_range(apart) == pytest.approx(tuple(np.percentile(known, [1, 99])))
    bar = umap_drawing().notes[0][0]
    assert bar.scale == distance_range(apart)


def test_missing_coordinates_show_a_message():
    no_points = np.full((N, 2), np.nan)
    drawing = umap_drawing(points={"sim": no_points, "real": no_points})
    assert "no coordinates" in draw_cells(drawing, SIZE).lines()[0]
