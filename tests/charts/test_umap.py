"""The UMAP view: common frame, mean colour of a cell, and counts."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.canvas import DARK, LIGHT, ColourMode, RenderOptions
from s2rtui.canvas.colour import legible, turbo
from s2rtui.canvas.marks import Mark
from s2rtui.charts.umap.model import LEVELS, UmapInput, umap_frame, umap_model
from s2rtui.charts.umap.terminal import (
    AXES,
    SHADE_STEPS,
    _left_ticks,
    draw_umap,
    umap_layout,
    umap_panels,
)
from tests.charts.examples import N, umap_input

SIZE = (60, 14)
COUNT = 25
points = arrays.arrays(np.float64, (COUNT, 2), elements=st.floats(-9, 9) | st.just(np.nan))
masks = arrays.arrays(np.bool_, COUNT)
values = arrays.arrays(np.float64, COUNT, elements=st.floats(-1, 5) | st.just(np.nan))


@pytest.mark.parametrize("scale", [1.0, 10.5, 1234.5, 1e-4, 1e7])
def test_no_tick_of_the_vertical_axis_is_cut(scale):
    for height in range(4, 40, 3):
        ticks = _left_ticks(-scale, scale, height)
        assert all(len(text) < AXES for _, text in ticks)
        assert [float(text) for _, text in ticks] == pytest.approx([tick for tick, _ in ticks])


@given(points, points, values, masks, masks)
def test_cells_show_the_mean_of_selected_instances(sim, real, values, selected, valid):
    view = umap_input(
        sim=sim, real=real, values=values, selected=selected, valid=valid, value_range=(0.0, 4.0),
        cursor=None,
    )  # fmt: skip
    frame = umap_frame(view, 9, 5)
    model = umap_model(view, frame)
    for side, layer in ((sim, model.sim), (real, model.real)):
        cells: dict[tuple[int, int], list[float]] = {}
        occupied = np.zeros((5, 9), dtype=np.bool_)
        for iid in range(COUNT):
            if not valid[iid] or not np.isfinite(side[iid]).all():
                continue
            column, row = (math.floor(part) for part in frame.to_cells(side[iid : iid + 1])[0])
            occupied[row, column] = True
            if selected[iid]:
                cells.setdefault((row, column), []).append(values[iid])
        for (row, column), cell_values in cells.items():
            known = np.clip([value for value in cell_values if np.isfinite(value)], 0.0, 4.0)
            level = layer.level[row, column]
            if known.size:
                assert abs((level - 0.5) / LEVELS - known.mean() / 4.0) <= 1.001 / LEVELS
            else:
                assert level == 0
        highlighted = np.zeros((5, 9), dtype=np.bool_)
        for cell in cells:
            highlighted[cell] = True
        np.testing.assert_array_equal(layer.level >= 0, highlighted)
        grey = layer.grey.reshape(5, 4, 9, 2).any(axis=(1, 3))
        np.testing.assert_array_equal(grey, occupied & ~highlighted)
        placed = valid & np.isfinite(side).all(axis=1)
        assert (layer.selected, layer.total) == ((placed & selected).sum(), placed.sum())


def test_default_values_are_the_sim_to_real_distances():
    view = umap_input()
    distances = np.hypot(*(view.sim - view.real).T)
    given_values = umap_input(values=distances)
    for size in (SIZE, (50, 10)):
        np.testing.assert_array_equal(draw_umap(view, size).fg, draw_umap(given_values, size).fg)
    low, high = umap_model(view, umap_frame(view, 10, 10)).value_range
    known = distances[np.isfinite(distances)]
    assert (low, high) == pytest.approx(tuple(np.percentile(known, [1, 99])))


def test_both_panels_have_the_same_scale_and_are_stacked_in_a_tall_view():
    for size in (SIZE, (20, 60)):
        sim, real = umap_panels(umap_input(), size)
        assert (sim.width, sim.height) == (real.width, real.height)
        corners = [panel.to_data(panel.x, panel.y) for panel in (sim, real)]
        assert corners[0] == pytest.approx(corners[1])
        assert sim.to_cells(0, 5)[1] < sim.to_cells(0, 0)[1]
    wide, high = (umap_layout(umap_input(), size).corners for size in ((60, 14), (20, 40)))
    assert wide[0][1] == wide[1][1]
    assert high[0][0] == high[1][0]


@pytest.mark.parametrize("theme", [DARK, LIGHT])
def test_a_selected_point_has_the_colour_of_its_value(theme):
    selected = np.arange(N) == 20
    values = np.full(N, 3.3)
    view = umap_input(selected=selected, values=values, value_range=(0.0, 4.0), cursor=None)
    canvas = draw_umap(view, SIZE, RenderOptions(theme=theme))
    sim, _ = umap_panels(view, SIZE)
    column, row = (int(part) for part in sim.to_cells(*view.sim[20]))
    level = math.floor(3.3 / 4 * LEVELS)
    assert 0x2800 < ord(canvas.char[row, column]) <= 0x28FF
    expected = legible(turbo([(level + 0.5) / LEVELS]), theme)[0]
    np.testing.assert_array_equal(canvas.fg[row, column], expected)


def test_digits_replace_colours():
    selected = np.isin(np.arange(N), [20, 45, 50])
    values = np.zeros(N)
    values[45], values[50] = 4.0, np.nan
    view = umap_input(selected=selected, values=values, value_range=(0.0, 4.0), cursor=None)
    for options in (RenderOptions(mode=ColourMode.NONE), RenderOptions(ascii=True)):
        canvas = draw_umap(view, SIZE, options)
        sim, _ = umap_panels(view, SIZE, options)
        for iid, digit in ((20, "0"), (45, "9"), (50, "?")):
            column, row = (int(part) for part in sim.to_cells(*view.sim[iid]))
            assert canvas.char[row, column] == digit


def test_the_cursor_is_marked_in_both_panels():
    view = umap_input(cursor=17)
    canvas = draw_umap(view, SIZE)
    for panel, side in zip(umap_panels(view, SIZE), (view.sim, view.real), strict=True):
        column, row = (int(part) for part in panel.to_cells(*side[17]))
        assert canvas.char[row, column] == "◉"
    assert "".join(canvas.lines()).count("◉") == 2
    screen = "".join(draw_umap(umap_input(cursor=3), SIZE).lines())
    assert "◉" not in screen


@pytest.mark.parametrize("crowd", [1, 8, 9, 512, 513, 4096, 4097])
def test_a_cell_shows_how_many_points_it_has(crowd):
    rng = np.random.default_rng(crowd)
    points = np.full((crowd + 2, 2), 5.1) + rng.uniform(-0.002, 0.002, (crowd + 2, 2))
    points[:2] = (0.0, 0.0), (10.0, 10.0)
    everyone = np.ones(len(points), dtype=np.bool_)
    view = UmapInput(points, points, None, np.zeros_like(everyone), everyone)
    canvas = draw_umap(view, SIZE)
    sim, _ = umap_panels(view, SIZE)
    chart = canvas.char[sim.y : sim.y + sim.height, sim.x : sim.x + sim.width]
    shades = canvas.glyphs.shades
    expected = shades[sum(crowd >= least for least in SHADE_STEPS)].strip()
    assert "".join(glyph for glyph in chart.ravel() if glyph in shades).strip() == expected
    braille = sum("\u2800" < glyph <= "\u28ff" for glyph in chart.ravel())
    assert braille == 2 + (not expected)


def test_cells_with_selected_points_show_these_alone():
    points = np.array([[0.0, 0.0], [10.0, 10.0], [5.0, 5.0], *np.full((20, 2), 5.0)])
    selected = np.arange(len(points)) == 2
    view = UmapInput(points, points, None, selected, np.ones_like(selected))
    layer = umap_model(view, umap_frame(view, 20, 10)).sim
    shown = layer.level >= 0
    assert layer.count[shown].tolist() == [1]
    assert layer.count[~shown].sum() == 2


@pytest.mark.parametrize("width", [40, 60, 90, 120])
def test_the_legend_says_what_a_cell_shows(width):
    text = " ".join(" ".join(draw_umap(umap_input(), (width, 30)).lines()).split())
    for words in ("distance", "mean of the selected", "none selected", "1 to 8", "+ per cell"):
        assert words in text


def test_missing_coordinates_show_a_message():
    no_points = np.full((N, 2), np.nan)
    assert "no coordinates" in draw_umap(umap_input(sim=no_points, real=no_points), SIZE).lines()[0]


def test_a_pending_box_is_drawn_on_its_panel():
    mark = Mark("real", ((0.0, 0.0), (4.0, 4.0)))
    view = umap_input(mark=mark)
    canvas = draw_umap(view, SIZE)
    sim, real = umap_panels(view, SIZE)
    for point in mark.points:
        column, row = (int(part) for part in real.to_cells(*point))
        assert canvas.char[row, column] == "+"
    left = canvas.char[sim.y : sim.y + sim.height, : sim.x + sim.width]
    assert not (left == "+").any()
