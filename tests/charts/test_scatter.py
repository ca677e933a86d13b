"""The scatter view: axes, zoom and brushes compared with independent computation."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from matplotlib.path import Path as Polygon

from s2rstore.language import mask, parse
from s2rstore.records import Bounds
from s2rtui.canvas import BrushShape
from s2rtui.charts.mark_expressions import box_expression, lasso_expression
from s2rtui.charts.scatter import drawn_errors, error_scale, scatter_drawing, scatter_summary
from s2rtui.drawing.cells import draw_cells, drawing_panels
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.points import Grid, point_cells
from tests.charts.examples import scatter_errors, scatter_of
from tests.support.columns import mask_context

SIZE = (60, 22)
N = 40
plain = arrays.arrays(np.float64, N, elements=st.floats(0, 9).map(lambda e: round(e, 2)))
spread = arrays.arrays(np.float64, N, elements=st.floats(-7, 4).map(math.exp) | st.just(0.0))
errors = plain | spread


def view(sim: np.ndarray, real: np.ndarray, selected=None, valid=None, **changes) -> Drawing:
    everything = np.ones(len(sim), dtype=np.bool_)
    return scatter_drawing(
        sim, real, everything if selected is None else selected,
        everything if valid is None else valid, **changes,
    )  # fmt: skip


def text(drawing: Drawing, size: tuple[int, int]) -> str:
    return "\n".join(draw_cells(drawing, size).lines())


def test_axes_are_logarithmic_where_errors_spread_widely():
    narrow = error_scale(np.array([0.5, 1.0, 2.0]), np.array([1.0, 4.0, 9.0]))
    assert (narrow.log, narrow.low) == (False, 0.0)
    wide = error_scale(np.array([0.02, 0.05, 0.3]), np.array([0.5, 4.0, 9.0]))
    assert wide.log
    assert 0 < wide.low <= 0.02
    assert wide.high > 9
    legend = text(view(*np.exp(np.mgrid[0:2, -5:9][1])), (120, 30))
    assert "log axes: the largest error is over 20 times the median of a side" in legend
    nothing = error_scale(np.array([np.nan]), np.array([0.0]))
    assert (nothing.low, nothing.high, nothing.log) == (0.0, 1.0, False)


def test_errors_below_a_log_axis_are_drawn_at_its_edge_and_counted():
    sim, real = np.concatenate([[0.0], np.geomspace(0.01, 20, 199)]), np.full(200, 1.0)
    scale, everything = error_scale(sim, real), np.ones(200, dtype=np.bool_)
    below = scatter_summary(sim, real, everything, everything).below
    assert below == int((sim < scale.low).sum()) > 0
    assert drawn_errors(sim, scale)[0] == scale.low
    assert f"{below} below {scale.low:g} m at the edge" in text(view(sim, real), (120, 40))
    low = text(view(sim, real), (80, 21))
    assert "at the edge" in low


@st.composite
def boxes(draw: st.DrawFn) -> tuple[int, int, int, int]:
    x = sorted(draw(st.lists(st.integers(0, 30), min_size=2, max_size=2, unique=True)))
    y = sorted(draw(st.lists(st.integers(0, 14), min_size=2, max_size=2, unique=True)))
    return x[0], y[0], x[1], y[1]


@given(errors, errors, boxes())
def test_a_box_selects_exactly_the_dots_inside(sim, real, box):
    scale, panel = error_scale(sim, real), drawing_panels(view(sim, real), SIZE)[0]
    x0, y0, x1, y1 = box
    corners = [(panel.x + min(x, panel.width), min(y, panel.height)) for x, y in
               ((x0, y0), (x1, y1))]  # fmt: skip
    cell = (1 / panel.width, 1 / panel.height)
    mark = BrushShape("errors", tuple(panel.to_data(*corner) for corner in corners))
    expression = box_expression(scale, sim, real, mark, cell)
    chosen = mask(parse(expression), mask_context(N, sim_error=sim, real_error=real))
    across, up = (scale.fraction(drawn_errors(side, scale)) for side in (sim, real))
    places = np.stack([across, 1 - up], axis=1)
    places = places * (panel.width, panel.height)
    near = np.abs(places - np.round(places)).min(axis=1) < 1e-6
    inside = (
        (places[:, 0] >= x0) & (places[:, 0] < min(x1, panel.width))
        & (places[:, 1] >= y0) & (places[:, 1] < min(y1, panel.height))
    )  # fmt: skip
    assert np.array_equal(chosen[~near], inside[~near]), expression


def test_a_box_over_the_whole_plot_selects_all():
    sim, real = scatter_errors()
    panel = drawing_panels(scatter_of(), SIZE)[0]
    corners = ((panel.x - 1, panel.height + 1), (panel.x + panel.width + 1, -1))
    mark = BrushShape("errors", tuple(panel.to_data(*corner) for corner in corners))
    assert box_expression(error_scale(sim, real), sim, real, mark, (0.02, 0.05)) == "all"


@given(
    errors, errors,
    st.lists(st.tuples(st.floats(0.02, 0.98), st.floats(0.02, 0.98)), min_size=3, max_size=3),
)  # fmt: skip
def test_a_lasso_selects_the_dots_inside_the_drawn_polygon(sim, real, corners):
    axis = error_scale(sim, real)
    mark = BrushShape(
        "errors",
        tuple((float(axis.value(x)), float(axis.value(y))) for x, y in corners),
        lasso=True,
    )
    expression = lasso_expression(axis, mark, (0.02, 0.05))
    chosen = mask(parse(expression), mask_context(N, sim_error=sim, real_error=real))
    places = np.stack([axis.fraction(np.maximum(sim, 1e-300)),
                       axis.fraction(np.maximum(real, 1e-300))], axis=1)  # fmt: skip
    segments = zip(corners, [*corners[1:], corners[0]], strict=True)
    apart = np.min([_distance(places, np.array(a), np.array(b)) for a, b in segments], axis=0)
    clear = apart > 0.02
    assume(clear.any())
    polygon = Polygon([*corners, corners[0]], closed=True)
    assert np.array_equal(chosen[clear], polygon.contains_points(places)[clear])


def _distance(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distances of points (N, 2) from the segment between a and b."""
    along = b - a
    share = np.clip((points - a) @ along / max(float(along @ along), 1e-12), 0, 1)
    return np.linalg.norm(points - a - share[:, None] * along, axis=1)


@given(errors, errors, st.floats(0, 0.7), st.floats(0, 0.7), st.floats(0.1, 0.4))
def test_a_zoomed_plot_shows_the_instances_in_view(sim, real, left, low, size):
    shown = Bounds(left, low, left + size, low + size)
    drawing, scale = view(sim, real, shown=shown), error_scale(sim, real)
    (plot,), panel = drawing.plots, drawing_panels(drawing, SIZE)[0]
    across, up = (
        (scale.fraction(drawn_errors(side, scale)) - start) / size
        for side, start in ((sim, left), (real, low))
    )
    inside = (across >= 0) & (across < 1) & (up >= 0) & (up < 1)
    edges = np.stack([across, 1 - across, up, 1 - up])
    assume(not (np.abs(edges) < 1e-9).any())
    cells = point_cells(plot.marks[-1], Grid(plot.x, plot.y, panel.width, panel.height))
    assert cells.total == inside.sum()
    for iid in np.flatnonzero(inside & (sim >= scale.low) & (real >= scale.low)):
        column, row = panel.to_cells(float(sim[iid]), float(real[iid]))
        assert column - panel.x == pytest.approx(across[iid] * panel.width, abs=1e-6)
        assert row == pytest.approx((1 - up[iid]) * panel.height, abs=1e-6)


def test_a_box_over_a_zoomed_plot_selects_the_instances_in_view():
    (sim, real), shown = scatter_errors(), Bounds(0.1, 0.1, 0.5, 0.5)
    valid = np.arange(60) != 3
    drawing = view(sim, real, valid=valid, shown=shown)
    (plot,), panel = drawing.plots, drawing_panels(drawing, SIZE)[0]
    corners = ((panel.x, panel.height), (panel.x + panel.width, 0))
    mark = BrushShape("errors", tuple(panel.to_data(*corner) for corner in corners))
    cell = (0.4 / panel.width, 0.4 / panel.height)
    expression = box_expression(error_scale(sim, real), sim, real, mark, cell)
    chosen = mask(parse(expression), mask_context(60, sim_error=sim, real_error=real))
    cells = point_cells(plot.marks[-1], Grid(plot.x, plot.y, panel.width, panel.height))
    assert 0 < chosen.sum() < 60
    assert (chosen & valid).sum() == cells.selected


@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize("start", [0.0, 0.01])
@pytest.mark.parametrize("end", [0.018, 0.015, 0.02])
def test_a_box_that_ends_at_the_smallest_error_is_an_expression(place, start, end):
    columns = [np.linspace(0.018, 3, N), np.linspace(0.018, 3, N)]
    corners = [[-1.0, -1.0], [9.0, 9.0]]
    corners[0][place], corners[1][place] = start, end
    mark = BrushShape("errors", (tuple(corners[0]), tuple(corners[1])))
    expression = box_expression(error_scale(*columns), *columns, mark, (0.02, 0.05))
    chosen = mask(parse(expression), mask_context(N, sim_error=columns[0], real_error=columns[1]))
    assert np.flatnonzero(chosen).tolist() == ([0] if end > 0.018 else [])
