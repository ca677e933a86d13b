"""Error glyphs of the map: means, directions, sizes and distinguishability."""

from dataclasses import replace

import numpy as np
import pytest

from s2rtui.canvas import DARK, ColourMode, RenderOptions
from s2rtui.canvas.render_options import UNICODE
from s2rtui.charts.map.model import SINGLES, arc_degrees, arc_turns, error_glyphs, full_scale
from s2rtui.charts.map.terminal import draw_map, map_layout
from s2rtui.charts.shared.base_map_model import MapInput, map_model
from tests.charts.examples import BOUNDS, map_input

SIZE = (80, 26)


def one_point(sim: tuple[float, float], real: tuple[float, float], y_down: bool = True) -> MapInput:
    """One instance in the middle of the map with these error vectors."""
    truth = np.array([[10.0, 5.0]])
    all_true = np.ones(1, dtype=np.bool_)
    columns = (truth, truth + sim, truth + real, np.zeros(1), all_true, all_true)
    return MapInput(*columns, BOUNDS, mode="glyph", y_down=y_down)


def many_points(count: int) -> MapInput:
    random = np.random.default_rng(3)
    truth = random.uniform((0, 0), (20, 10), (count, 2))
    errors = random.normal(0, 1, (2, count, 2))
    real = truth + errors[1]
    real[::7] = np.nan
    selected, valid = random.random(count) < 0.6, random.random(count) < 0.9
    columns = (truth, truth + errors[0], real, np.zeros(count), selected, valid)
    return MapInput(*columns, BOUNDS, mode="glyph")


def test_blocks_show_the_mean_errors_of_selected_instances():
    view = many_points(2000)
    frame = map_layout(view, SIZE).frame
    blocks = error_glyphs(view, map_model(view), frame, (7, 3))
    cells = np.floor(frame.to_cells(view.truth))
    known = np.isfinite(view.real).all(axis=1) & view.selected & view.valid
    assert blocks.counts.sum() == known.sum() > SINGLES
    assert blocks.crowded
    for index, (column, row) in enumerate(blocks.centres):
        block = known & (cells[:, 0] // 7 == column // 7) & (cells[:, 1] // 3 == row // 3)
        assert blocks.counts[index] == block.sum()
        for vectors, side in ((blocks.sim, view.sim), (blocks.real, view.real)):
            mean = (side - view.truth)[block].mean(axis=0)
            assert vectors[index] == pytest.approx(mean)


def test_few_instances_are_drawn_at_their_truth_and_merged_when_close():
    truth = np.array([[5.0, 5.0], [5.2, 5.0], [15.0, 2.0]])
    sim = truth + np.array([[1.0, 0.0], [3.0, 0.0], [0.0, 1.0]])
    all_true = np.ones(3, dtype=np.bool_)
    view = MapInput(truth, sim, sim, np.zeros(3), all_true, all_true, BOUNDS, mode="glyph")
    frame = map_layout(view, SIZE).frame
    blocks = error_glyphs(view, map_model(view), frame, (7, 3))
    assert blocks.counts.tolist() == [2, 1]
    assert blocks.sim[0] == pytest.approx([2.0, 0.0])
    assert blocks.centres[1] == pytest.approx(frame.to_cells(truth[2:])[0])
    canvas, layout = draw_map(view, SIZE), map_layout(view, SIZE)
    column, row = np.floor(blocks.centres[0]).astype(int)
    assert canvas.char[row, column + layout.x] == "2"


def test_arcs_grow_with_the_error_within_limits_and_point_as_the_map():
    vectors = np.array([[0.0, 0.0], [5.0, 0.0], [10.0, 0.0], [40.0, 0.0], [np.nan, 0.0]])
    degrees = arc_degrees(vectors, 10.0)
    assert degrees[:4].tolist() == [20.0, 90.0, 180.0, 180.0]
    assert np.isnan(degrees[4])
    for y_down, turn in ((True, np.pi / 2), (False, -np.pi / 2)):
        assert arc_turns(np.array([[0.0, 2.0]]), y_down)[0] == pytest.approx(turn)


def test_full_scale_is_the_99th_percentile_of_valid_errors():
    view = many_points(500)
    errors = [np.hypot(*(side - view.truth)[view.valid].T) for side in (view.sim, view.real)]
    both = np.concatenate(errors)
    assert full_scale(view) == pytest.approx(np.percentile(both[np.isfinite(both)], 99))


def centre_of(view: MapInput, options: RenderOptions) -> tuple[int, int]:
    layout = map_layout(view, SIZE, None, options)
    column, row = np.floor(layout.frame.to_cells(view.truth)[0]).astype(int)
    return int(column) + layout.x, int(row)


@pytest.mark.parametrize("y_down", [True, False])
def test_marks_of_both_sides_are_drawn_in_the_error_direction(y_down):
    view = one_point((3.0, 0.0), (0.0, 3.0), y_down)
    canvas = draw_map(view, SIZE)
    column, row = centre_of(view, RenderOptions())
    assert canvas.char[row, column] == UNICODE.truth
    assert canvas.char[row, column + 2] == UNICODE.sim
    assert tuple(canvas.fg[row, column + 2]) == DARK.sim
    below = row + (1 if y_down else -1)
    assert canvas.char[below, column] == UNICODE.real
    assert tuple(canvas.fg[below, column]) == DARK.real


def test_equal_errors_have_a_separate_colour_and_glyph():
    view = one_point((-3.0, 0.0), (-3.0, 0.0))
    canvas = draw_map(view, SIZE)
    column, row = centre_of(view, RenderOptions())
    left = (slice(row - 1, row + 2), slice(column - 3, column))
    inked = canvas.char[left] != " "
    assert UNICODE.both in canvas.char[left]
    colours = {tuple(colour) for colour in canvas.fg[left][inked]}
    assert colours == {DARK.both}


@pytest.mark.parametrize(
    "options", [RenderOptions(ascii=True), RenderOptions(mode=ColourMode.NONE)]
)
def test_arrows_with_letters_and_sizes_replace_colours(options):
    view = one_point((3.0, 0.0), (-1.0, -1.0))
    canvas = draw_map(view, SIZE, options)
    column, row = centre_of(view, options)
    glyphs = options.glyphs
    assert "".join(canvas.char[row, column + 1 : column + 4]) == f"{glyphs.arrows[0]}{glyphs.sim}9"
    left = "".join(canvas.char[row - 1, column - 3 : column])
    assert left == f"{glyphs.real}4{glyphs.arrows[5]}"


def test_equal_arrows_are_merged_with_both_sizes():
    options = RenderOptions(ascii=True)
    view = one_point((0.0, 1.0), (0.0, 3.0))
    canvas = draw_map(view, SIZE, options)
    column, row = centre_of(view, options)
    assert "".join(canvas.char[row + 1, column : column + 4]) == "vB39"


def test_the_legend_explains_scale_and_means():
    text = "\n".join(draw_map(map_input(mode="glyph"), (120, 30)).lines())
    assert "180° = " in text
    assert "mean of n instances" in text
    one_selected = replace(map_input(mode="glyph"), selected=np.arange(60) == 5)
    assert "mean of n instances" not in "\n".join(draw_map(one_selected, (120, 30)).lines())
