"""The UMAP view: common scales, colours by distance, panels beside each other or stacked."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rstore.records import Bounds
from s2rtui.charts.umap import distance_levels, distance_range, distances, umap_extent
from s2rtui.drawing.cells import draw_cells, drawing_panels
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


def test_both_panels_have_the_same_scale_and_are_stacked_in_a_tall_view():
    for size in (SIZE, (20, 60)):
        sim, real = drawing_panels(umap_drawing(), size)
        assert (sim.width, sim.height) == (real.width, real.height)
        corners = [panel.to_data(panel.x, panel.y) for panel in (sim, real)]
        assert corners[0] == pytest.approx(corners[1])
        assert sim.to_cells(0, 5)[1] < sim.to_cells(0, 0)[1]
        (x0, y0), (x1, y1) = sim.to_data(0, 0), sim.to_data(1, 1)
        assert 2 * (x1 - x0) == pytest.approx(y0 - y1)  # a cell is twice as high as wide
    wide, high = (drawing_panels(umap_drawing(), size) for size in ((60, 14), (20, 40)))
    assert wide[0].y == wide[1].y
    assert high[0].x == high[1].x


def test_all_points_are_in_view():
    sim, real = umap_points().values()
    area = umap_extent(*sim.T, *real.T)
    for side in (sim, real):
        x, y = side[np.isfinite(side).all(axis=1)].T
        assert (area.x0 < x).all() & (x < area.x1).all() & (area.y0 < y).all() & (y < area.y1).all()
    nothing = np.full((3, 2), np.nan)
    assert umap_extent(*nothing.T, *nothing.T) == Bounds(0.0, 0.0, 1.0, 1.0)


def test_missing_coordinates_show_a_message():
    no_points = np.full((N, 2), np.nan)
    drawing = umap_drawing(points={"sim": no_points, "real": no_points})
    assert "no coordinates" in draw_cells(drawing, SIZE).lines()[0]
