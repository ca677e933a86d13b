"""Map layers: clipping, rooms, marks, and the conversion of cells to metres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.records import Bounds, Room
from s2rtui.canvas import DARK, DEFAULT_OPTIONS, ColourMode, RenderOptions
from s2rtui.canvas.colour import mix
from s2rtui.canvas.marks import Mark, panel_at
from s2rtui.charts.compare.terminal import compare_panels
from s2rtui.charts.map.terminal import draw_map, map_layout, map_panels
from s2rtui.charts.shared.base_map_background import DIMMED
from tests.charts.examples import compare_input, map_input

SIZE = (80, 26)
LEFT_HALF = np.array([[1, 1, 0, 0]] * 2)
"""Mask in which only the left half of the map is visible."""


def cell_at(x: float, y: float, options: RenderOptions = DEFAULT_OPTIONS) -> tuple[int, int]:
    """Row and column of a point on the example map."""
    layout = map_layout(map_input(), SIZE, None, options)
    column, row = layout.frame.to_cells([[x, y]])[0].astype(int)
    return int(row), int(column) + layout.x


@pytest.mark.parametrize(
    "clip", [LEFT_HALF, LEFT_HALF.astype(bool), np.where(LEFT_HALF, 3.5, np.nan)]
)
def test_clipping_dims_only_the_hidden_area(clip: np.ndarray) -> None:
    view = map_input(cursor=None, rooms=())
    before, after = draw_map(view, SIZE), draw_map(replace(view, clip=clip), SIZE)
    visible, hidden = cell_at(5.0, 3.0), cell_at(15.0, 5.0)
    assert (after.bg[visible] == before.bg[visible]).all()
    expected = mix(before.bg[hidden], np.array(DARK.background), DIMMED)
    assert (np.abs(after.bg[hidden].astype(int) - expected) <= 1).all()


@pytest.mark.parametrize(
    "options", [RenderOptions(ascii=True), RenderOptions(mode=ColourMode.ANSI)]
)
def test_clipping_removes_background_glyphs_of_the_hidden_area(options: RenderOptions) -> None:
    view = map_input(cursor=None, rooms=(), clip=1 - LEFT_HALF)
    unclipped = draw_map(replace(view, clip=None), SIZE, options)
    clipped = draw_map(view, SIZE, options)
    heat_cell, bright_cell = cell_at(5.0, 3.0, options), cell_at(18.5, 5.0, options)
    assert unclipped.char[heat_cell] != " "
    assert clipped.char[heat_cell] == " "
    assert clipped.char[bright_cell] == unclipped.char[bright_cell] != " "
    assert "not seen" in "\n".join(draw_map(view, (110, 26), options).lines())


def test_clipping_keeps_the_points() -> None:
    view = map_input(cursor=None, rooms=(), clip=np.zeros((3, 3)))
    assert sum(line.count("●") for line in draw_map(view, SIZE).lines()) > 5


def test_room_names_and_outlines_are_optional() -> None:
    view = map_input(cursor=None, floor_plan=None, heat=None)
    with_names = draw_map(view, SIZE)
    text = "\n".join(with_names.lines())
    assert "hall" in text
    assert "größer" in text
    wall = cell_at(10.0, 3.6)
    column = with_names.char[:, wall[1]]
    assert sum(0x2800 < ord(glyph) <= 0x28FF for glyph in column.tolist()) > 8
    without_names = "\n".join(draw_map(replace(view, room_names=False), SIZE).lines())
    assert "hall" not in without_names


def test_room_names_are_whole_and_avoid_the_points() -> None:
    along = np.linspace(1.0, 9.0, 60)
    truth = np.stack([along, np.full(60, 5.0)], axis=1)
    room = (Room("corridor", 0, 0, 0, 10, 10),)
    view = map_input(truth=truth, rooms=room, cursor=None, heat=None, floor_plan=None)
    all_selected = replace(view, selected=np.ones(60, dtype=np.bool_))
    bare = draw_map(replace(all_selected, rooms=()), SIZE)
    named = draw_map(all_selected, SIZE)
    assert "corridor" in "\n".join(named.lines())
    drawn = [np.isin(canvas.char, ("●", "■")).sum() for canvas in (named, bare)]
    assert drawn[0] == drawn[1] > 20


def test_a_room_name_in_a_full_room_is_drawn_in_front_of_the_points() -> None:
    across, down = np.meshgrid(np.linspace(0, 10, 200), np.linspace(0, 10, 200))
    truth = np.stack([across.ravel(), down.ravel()], axis=1)
    everywhere = np.ones(len(truth), dtype=np.bool_)
    view = map_input(
        truth=truth, sim=truth, real=truth, values=truth[:, 0], headings=None, cursor=None,
        rooms=(Room("corridor", 0, 0, 0, 10, 10),), selected=everywhere, valid=everywhere,
    )  # fmt: skip
    canvas = draw_map(view, SIZE)
    row = next(row for row, line in enumerate(canvas.lines()) if "corridor" in line)
    column = canvas.lines()[row].index("corridor")
    assert (canvas.bg[row, column : column + 8] == np.array(DARK.background)).all()


@given(
    size=st.tuples(st.integers(1, 120), st.integers(1, 50)),
    y_down=st.booleans(),
    near=st.booleans(),
    part=st.tuples(st.floats(0, 0.999), st.floats(0, 0.999)),
)
def test_cells_convert_to_metres_and_back(
    size: tuple[int, int], y_down: bool, near: bool, part: tuple[float, float]
) -> None:
    viewport = Bounds(3.0, 2.0, 6.0, 4.0) if near else None
    for (panel,) in (
        map_panels(map_input(y_down=y_down), size, RenderOptions(), viewport),
        compare_panels(compare_input(y_down=y_down), size, RenderOptions(), viewport),
    ):
        assert (panel.name, panel.shape) == ("map", "plane")
        column, row = panel.x + int(part[0] * panel.width), panel.y + int(part[1] * panel.height)
        assert panel_at((panel,), column, row) is panel
        cell = panel.to_cells(*panel.to_data(column + 0.5, row + 0.5))
        assert cell == pytest.approx((column + 0.5, row + 0.5))


def test_the_panel_matches_the_drawn_points() -> None:
    view = map_input(floor_plan=None, heat=None, rooms=(), cursor=None)
    (panel,) = map_panels(view, SIZE)
    column, row = panel.to_cells(*view.truth[59])
    assert draw_map(view, SIZE).char[int(row), int(column)] == "●"


@pytest.mark.parametrize("mode", ["colour", "glyph", "full"])
@pytest.mark.parametrize(
    "options", [RenderOptions(), RenderOptions(mode=ColourMode.NONE, ascii=True)]
)
def test_a_mark_is_drawn_at_its_coordinates(mode: str, options: RenderOptions) -> None:
    view = map_input(mode=mode, cursor=None, mark=Mark("map", ((2.0, 1.0), (12.0, 9.0))))
    canvas = draw_map(view, SIZE, options)
    (panel,) = map_panels(view, SIZE, options)
    for corner in ((2.0, 1.0), (12.0, 9.0), (2.0, 9.0)):
        column, row = (int(part) for part in panel.to_cells(*corner))
        assert canvas.char[row, column] == "+"
        assert tuple(canvas.fg[row, column]) == DARK.truth
