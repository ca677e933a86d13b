"""Error glyphs of the map: means, directions, sizes and distinguishability."""

import numpy as np
import pytest

from s2rtui.canvas import DARK, ColourMode, RenderOptions
from s2rtui.canvas.render_options import UNICODE
from s2rtui.charts.map import MapInput, map_drawing
from s2rtui.drawing.arcs import (
    SINGLES,
    ErrorGlyphs,
    arc_degrees,
    arc_overlap,
    arc_turns,
    error_glyphs,
)
from s2rtui.drawing.drawing_layout import drawing_layout
from s2rtui.drawing.plane_marks import Arcs
from s2rtui.drawing.points import Grid
from tests.charts.examples import draw_map, map_input, map_place, points_of

SIZE = (80, 26)


def shown(view: MapInput, footprint: tuple[int, int] = (7, 3)) -> tuple[Arcs, ErrorGlyphs]:
    """The arcs of a map in `SIZE` and their glyphs."""
    place = drawing_layout(map_drawing(view), SIZE, RenderOptions()).plots[0]
    (arcs,) = (mark for mark in place.plot.marks if isinstance(mark, Arcs))
    grid = Grid(place.plot.x, place.plot.y, place.width, place.rows)
    return arcs, error_glyphs(arcs, grid, footprint)


def glyph_map(truth: np.ndarray, sim: np.ndarray, real: np.ndarray, **changes: object) -> MapInput:
    """Instances at these points in mode "glyph", without a cursor and a floor."""
    everyone = np.ones(len(truth), dtype=np.bool_)
    fields = {"selected": everyone, "valid": everyone, **changes}
    return map_input(
        truth=truth, sim=sim, real=real, values=np.zeros(len(truth)), mode="glyph", headings=None,
        cursor=None, plan=None, heat=None, rooms=(), **fields,
    )  # fmt: skip


def one_point(sim: tuple[float, float], real: tuple[float, float]) -> MapInput:
    """One instance in the middle of the map with these error vectors."""
    truth = np.array([[10.0, 5.0]])
    return glyph_map(truth, truth + sim, truth + real)


def many_points(count: int, **changes: object) -> MapInput:
    random = np.random.default_rng(3)
    truth = random.uniform((0, 0), (20, 10), (count, 2))
    errors = random.normal(0, 1, (2, count, 2))
    real = truth + errors[1]
    real[::7] = np.nan
    selected, valid = random.random(count) < 0.6, random.random(count) < 0.9
    return glyph_map(truth, truth + errors[0], real, selected=selected, valid=valid, **changes)


def test_blocks_show_the_mean_errors_of_selected_instances():
    view = many_points(2000)
    _, blocks = shown(view)
    cells = np.floor(map_place(map_drawing(view), SIZE).frame.to_cells(points_of(view)))
    known = np.isfinite(points_of(view, "real")).all(axis=1) & view.selected & view.valid
    assert blocks.counts.sum() == known.sum() > SINGLES
    assert blocks.is_crowded
    for index, (column, row) in enumerate(blocks.centres):
        block = known & (cells[:, 0] // 7 == column // 7) & (cells[:, 1] // 3 == row // 3)
        assert blocks.counts[index] == block.sum()
        for vectors, side in ((blocks.sim, "sim"), (blocks.real, "real")):
            mean = (points_of(view, side) - points_of(view))[block].mean(axis=0)
            assert vectors[index] == pytest.approx(mean)


def test_arcs_grow_with_the_error_within_limits_and_point_as_the_map():
    vectors = np.array([[0.0, 0.0], [5.0, 0.0], [10.0, 0.0], [40.0, 0.0], [np.nan, 0.0]])
    degrees = arc_degrees(vectors, 10.0)
    assert degrees[:4].tolist() == [20.0, 90.0, 180.0, 180.0]
    assert np.isnan(degrees[4])
    for y_down, turn in ((True, np.pi / 2), (False, -np.pi / 2)):
        assert arc_turns(np.array([[0.0, 2.0]]), y_down)[0] == pytest.approx(turn)


def test_arcs_overlap_across_360_degrees():
    first = np.array([[0, 40], [0, 40], [170, 190], [-10, 10], [0, 40]], dtype=float)
    second = np.array([[30, 90], [50, 90], [-190, -175], [355, 375], [np.nan, np.nan]])
    low, high = arc_overlap((first[:, 0], first[:, 1]), (second[:, 0], second[:, 1]))
    held = high > low
    assert held.tolist() == [True, False, True, True, False]
    assert np.stack([low, high], axis=1)[held].tolist() == [[30, 40], [170, 185], [-5, 10]]


def test_full_scale_is_the_99th_percentile_of_valid_errors():
    view = many_points(500)
    sides = (points_of(view, side) for side in ("sim", "real"))
    both = np.concatenate([np.hypot(*(side - points_of(view))[view.valid].T) for side in sides])
    assert shown(view)[0].full == pytest.approx(np.percentile(both[np.isfinite(both)], 99))


def centre_of(view: MapInput, options: RenderOptions) -> tuple[int, int]:
    row, column = map_place(map_drawing(view), SIZE, options).cells(points_of(view))[0]
    return column, row


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
