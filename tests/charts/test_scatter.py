"""The scatter view: counts, axes and brushes compared with independent computation."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from matplotlib.path import Path as Polygon

from s2rstore.language import mask, parse
from s2rstore.records import Bounds
from s2rtui.canvas import DARK, ColourMode, Mark, RenderOptions
from s2rtui.charts.scatter.axis import error_axis
from s2rtui.charts.scatter.brush import box_expression, lasso_expression
from s2rtui.charts.scatter.model import (
    DENSITY_ABOVE,
    QUADRANTS,
    ScatterInput,
    scatter_model,
    scatter_summary,
)
from s2rtui.charts.scatter.paper import scatter_figure
from s2rtui.charts.scatter.terminal import draw_scatter, scatter_layout, scatter_panels
from tests.charts.examples import scatter_input
from tests.support.columns import mask_context

SIZE = (60, 22)
N = 40
plain = arrays.arrays(np.float64, N, elements=st.floats(0, 9).map(lambda e: round(e, 2)))
spread = arrays.arrays(np.float64, N, elements=st.floats(-7, 4).map(math.exp) | st.just(0.0))
errors = plain | spread
masks = arrays.arrays(np.bool_, N)


def view(sim: np.ndarray, real: np.ndarray, selected=None, valid=None) -> ScatterInput:
    everything = np.ones(len(sim), dtype=np.bool_)
    return ScatterInput(
        sim, real, everything if selected is None else selected,
        everything if valid is None else valid,
    )  # fmt: skip


def ranked(values: np.ndarray, valid: np.ndarray, worst: bool) -> set[int]:
    """The iids of the worst or best 15 %, ties by iid, by sorting tuples."""
    keys = sorted((-values[iid] if worst else values[iid], iid) for iid in np.flatnonzero(valid))
    return {iid for _, iid in keys[: math.ceil(15 * len(keys) / 100)]}


@given(errors, errors, masks, masks)
def test_quadrants_and_sides_equal_a_count_by_hand(sim, real, selected, valid):
    summary = scatter_summary(view(sim, real, selected, valid))
    inside = {int(iid) for iid in np.flatnonzero(selected & valid)}
    for quadrant, (total, chosen) in zip(QUADRANTS, summary.quadrants, strict=True):
        both = ranked(sim, valid, quadrant.sim == "worst") & ranked(
            real, valid, quadrant.real == "worst"
        )
        assert (total, chosen) == (len(both), len(both & inside))
    assert summary.real_larger == sum(real[iid] > sim[iid] for iid in inside)
    assert summary.sim_larger == sum(sim[iid] > real[iid] for iid in inside)
    assert (summary.total, summary.selected) == (valid.sum(), len(inside))


@given(errors, errors, masks, masks)
def test_cells_count_the_selected_instances_at_their_place(sim, real, selected, valid):
    data = view(sim, real, selected, valid)
    layout = scatter_layout(data, SIZE)
    panel = scatter_panels(data, SIZE)[0]
    model = scatter_model(data, layout.width, layout.height)
    expected = np.zeros((layout.height, layout.width), dtype=int)
    for iid in np.flatnonzero(selected & valid):
        x, y = (max(float(error[iid]), data.axis.low) for error in (sim, real))
        column, row = panel.to_cells(x, y)
        expected[
            min(math.ceil(row - 1e-9) - 1 if row > 1e-9 else 0, layout.height - 1),
            min(int(column - layout.left + 1e-9), layout.width - 1),
        ] += 1
    # Places on the border of two cells may fall to either by rounding.
    assert model.count.sum() == expected.sum()
    assert np.abs(model.count - expected).sum() <= 4
    assert not (model.grey.reshape(layout.height, 4, layout.width, 2).any(axis=(1, 3))
                & (model.count > 0)).any()  # fmt: skip


def test_axes_are_logarithmic_where_errors_spread_widely():
    narrow = error_axis(np.array([0.5, 1.0, 2.0]), np.array([1.0, 4.0, 9.0]))
    assert (narrow.log, narrow.low) == (False, 0.0)
    wide = error_axis(np.array([0.02, 0.05, 0.3]), np.array([0.5, 4.0, 9.0]))
    assert wide.log
    assert 0 < wide.low <= 0.02
    assert wide.high > 9
    legend = "\n".join(draw_scatter(view(*np.exp(np.mgrid[0:2, -5:9][1])), (120, 30)).lines())
    assert "log axes: the largest error is over 20 times the median of a side" in legend
    nothing = error_axis(np.array([np.nan]), np.array([0.0]))
    assert (nothing.low, nothing.high, nothing.log) == (0.0, 1.0, False)


def test_errors_below_a_log_axis_are_drawn_at_its_edge_and_counted():
    sim = np.concatenate([[0.0], np.geomspace(0.01, 20, 199)])
    data = view(sim, np.full(200, 1.0))
    assert scatter_summary(data).below == int((sim < data.axis.low).sum()) > 0
    assert data.axis.drawn(0.0) == 0
    text = "\n".join(draw_scatter(data, (120, 40)).lines())
    assert f"{scatter_summary(data).below} below {data.axis.low:g} m at the edge" in text
    low = " ".join(draw_scatter(data, (80, 21)).lines())
    assert "at the edge" in low
    assert "…" not in low


@st.composite
def boxes(draw: st.DrawFn) -> tuple[int, int, int, int]:
    x = sorted(draw(st.lists(st.integers(0, 30), min_size=2, max_size=2, unique=True)))
    y = sorted(draw(st.lists(st.integers(0, 14), min_size=2, max_size=2, unique=True)))
    return x[0], y[0], x[1], y[1]


@given(errors, errors, boxes())
def test_a_box_selects_exactly_the_dots_inside(sim, real, box):
    data = view(sim, real)
    layout, panel = scatter_layout(data, SIZE), scatter_panels(data, SIZE)[0]
    x0, y0, x1, y1 = box
    corners = [(layout.left + min(x, layout.width), min(y, layout.height)) for x, y in
               ((x0, y0), (x1, y1))]  # fmt: skip
    cell = (1 / panel.width, 1 / panel.height)
    mark = Mark("errors", tuple(panel.to_data(*corner) for corner in corners))
    expression = box_expression(data.axis, sim, real, mark, cell)
    chosen = mask(parse(expression), mask_context(N, sim_error=sim, real_error=real))
    places = np.stack([data.axis.drawn(sim), 1 - data.axis.drawn(real)], axis=1)
    places = places * (panel.width, panel.height)
    near = np.abs(places - np.round(places)).min(axis=1) < 1e-6
    inside = (
        (places[:, 0] >= x0) & (places[:, 0] < min(x1, layout.width))
        & (places[:, 1] >= y0) & (places[:, 1] < min(y1, layout.height))
    )  # fmt: skip
    assert np.array_equal(chosen[~near], inside[~near]), expression


def test_a_box_over_the_whole_plot_selects_all():
    data = scatter_input()
    panel = scatter_panels(data, SIZE)[0]
    corners = ((panel.x - 1, panel.height + 1), (panel.x + panel.width + 1, -1))
    mark = Mark("errors", tuple(panel.to_data(*corner) for corner in corners))
    assert box_expression(data.axis, data.sim, data.real, mark, (0.02, 0.05)) == "all"


@given(
    errors, errors,
    st.lists(st.tuples(st.floats(0.02, 0.98), st.floats(0.02, 0.98)), min_size=3, max_size=3),
)  # fmt: skip
def test_a_lasso_selects_the_dots_inside_the_drawn_polygon(sim, real, corners):
    axis = error_axis(sim, real)
    mark = Mark("errors", tuple((axis.value(x), axis.value(y)) for x, y in corners), lasso=True)
    expression = lasso_expression(axis, mark, (0.02, 0.05))
    chosen = mask(parse(expression), mask_context(N, sim_error=sim, real_error=real))
    places = np.stack([axis.fractions(np.maximum(sim, 1e-300)),
                       axis.fractions(np.maximum(real, 1e-300))], axis=1)  # fmt: skip
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


def test_cells_with_several_instances_show_their_number():
    sim = np.array([1.0] * 3 + [4.0] * 12 + [8.0])
    real = np.array([8.0] * 3 + [2.0] * 12 + [1.0])
    data = view(sim, real)
    canvas, layout = draw_scatter(data, SIZE), scatter_layout(data, SIZE)
    panel = scatter_panels(data, SIZE)[0]
    for (x, y), glyph, ink in (
        ((1.0, 8.0), "3", DARK.real), ((4.0, 2.0), "+", DARK.sim), ((8.0, 1.0), "◆", DARK.sim),
    ):  # fmt: skip
        column, row = (int(place) for place in panel.to_cells(x, y))
        assert canvas.char[row, column] == glyph
        assert tuple(canvas.fg[row, column]) == ink
    assert layout.left > 0
    assert "2-9: that many instances, +: 10 or more" in "\n".join(canvas.lines())


@pytest.mark.parametrize("mode", [ColourMode.TRUECOLOR, ColourMode.NONE])
def test_many_instances_are_drawn_as_a_density(mode):
    random = np.random.default_rng(4)
    n = DENSITY_ABOVE + 1
    sim, real = random.gamma(2, 1, n), random.gamma(2, 1, n)
    data = view(sim, real, selected=sim > 1)
    canvas = draw_scatter(data, (80, 24), RenderOptions(mode=mode))
    layout = scatter_layout(data, (80, 24))
    model = scatter_model(data, layout.width, layout.height)
    assert model.dense
    assert model.count.sum() == (sim > 1).sum()
    text = "\n".join(canvas.lines())
    assert text.count("instances per cell, log: 1 ") == 1
    assert f" {model.peak} " in text
    assert "●" not in text
    assert len(scatter_figure(data, (600, 480))) > 1000


def test_the_cursor_and_the_limits_are_drawn():
    data = scatter_input(cursor=12)
    canvas, panel = draw_scatter(data, SIZE), scatter_panels(data, SIZE)[0]
    column, row = panel.to_cells(float(data.sim[12]), float(data.real[12]))
    assert canvas.char[int(row), int(column)] == "◉"
    limit = scatter_summary(data).sim.worst
    column = int(panel.to_cells(limit, 1.0)[0])
    assert "│" in set(canvas.char[: panel.height, column])


@pytest.mark.parametrize(
    ("options", "diagonal", "sides"),
    [(RenderOptions(mode=ColourMode.NONE), "╱", "◇◆"), (RenderOptions(ascii=True), "/", "RS")],
)
def test_diagonal_and_sides_have_glyphs_of_their_own(options, diagonal, sides):
    data = view(np.array([1.0, 8.0, 9.0]), np.array([8.0, 1.0, 9.0]))
    canvas, panel = draw_scatter(data, SIZE, options), scatter_panels(data, SIZE)[0]
    for x, y, glyph in ((1.0, 8.0, sides[0]), (8.0, 1.0, sides[1])):
        column, row = (int(place) for place in panel.to_cells(x, y))
        assert canvas.char[row, column] == glyph
    on_line = [panel.to_cells(error, error) for error in np.arange(2.0, 8.0, 0.5)]
    drawn = {str(canvas.char[int(row), int(column)]) for column, row in on_line}
    assert drawn <= {diagonal, *"│─|-"}
    assert diagonal in drawn
    legend = "\n".join(canvas.lines()[panel.height :])
    assert f"{sides[0]} real error larger" in legend
    assert f"{sides[1]} sim error larger" in legend
    assert f"{diagonal} sim = real" in legend


@given(errors, errors, st.floats(0, 0.7), st.floats(0, 0.7), st.floats(0.1, 0.4))
def test_a_zoomed_plot_shows_the_instances_in_view(sim, real, left, low, size):
    shown = Bounds(left, low, left + size, low + size)
    data = replace(view(sim, real), viewport=shown)
    layout, panel = scatter_layout(data, SIZE), scatter_panels(data, SIZE)[0]
    model = scatter_model(data, layout.width, layout.height)
    across = (data.axis.drawn(sim) - left) / size
    up = (data.axis.drawn(real) - low) / size
    inside = (across >= 0) & (across < 1) & (up >= 0) & (up < 1)
    edge = (np.minimum(np.abs(across), np.abs(1 - across)) < 1e-9) | (
        np.minimum(np.abs(up), np.abs(1 - up)) < 1e-9
    )
    assume(not edge.any())
    assert model.count.sum() == inside.sum()
    for iid in np.flatnonzero(inside & (sim >= data.axis.low) & (real >= data.axis.low)):
        column, row = panel.to_cells(float(sim[iid]), float(real[iid]))
        assert column - layout.left == pytest.approx(across[iid] * layout.width, abs=1e-6)
        assert row == pytest.approx((1 - up[iid]) * layout.height, abs=1e-6)
    draw_scatter(data, SIZE)


def test_a_box_over_a_zoomed_plot_selects_the_instances_in_view():
    data = replace(scatter_input(), viewport=Bounds(0.1, 0.1, 0.5, 0.5))
    panel = scatter_panels(data, SIZE)[0]
    corners = ((panel.x, panel.height), (panel.x + panel.width, 0))
    mark = Mark("errors", tuple(panel.to_data(*corner) for corner in corners))
    cell = (0.4 / panel.width, 0.4 / panel.height)
    chosen = mask(
        parse(box_expression(data.axis, data.sim, data.real, mark, cell)),
        mask_context(60, sim_error=data.sim, real_error=data.real),
    )
    model = scatter_model(replace(data, selected=data.valid), panel.width, panel.height)
    assert 0 < chosen.sum() < 60
    assert (chosen & data.valid).sum() == model.count.sum()
    assert len(scatter_figure(data, (600, 480))) > 1000


@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize("start", [0.0, 0.01])
@pytest.mark.parametrize("end", [0.018, 0.015, 0.02])
def test_a_box_that_ends_at_the_smallest_error_is_an_expression(place, start, end):
    columns = [np.linspace(0.018, 3, N), np.linspace(0.018, 3, N)]
    data = view(*columns)
    corners = [[-1.0, -1.0], [9.0, 9.0]]
    corners[0][place], corners[1][place] = start, end
    mark = Mark("errors", (tuple(corners[0]), tuple(corners[1])))
    expression = box_expression(data.axis, *columns, mark, (0.02, 0.05))
    chosen = mask(parse(expression), mask_context(N, sim_error=columns[0], real_error=columns[1]))
    assert np.flatnonzero(chosen).tolist() == ([0] if end > 0.018 else [])
