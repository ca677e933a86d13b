"""The map: points, heat of both signs, floor plan, unseen floor, names of rooms and error lines."""

from io import BytesIO
from typing import Any

import numpy as np
import pytest
from PIL import Image

from s2rstore.records import Bounds, Room
from s2rtui.analysis.map_frame import MapFrame, panned, sample, zoomed
from s2rtui.canvas import DARK, DEFAULT_OPTIONS, LIGHT, ColourMode, RenderOptions
from s2rtui.canvas.colour import legible, mix, turbo
from s2rtui.charts.map import MapInput, map_drawing
from s2rtui.drawing.drawing_layout import drawing_layout
from s2rtui.drawing.floor import DIMMED, floor_heat_scale
from s2rtui.drawing.heat_colours import map_opacity
from s2rtui.drawing.paper import draw_paper
from s2rtui.drawing.plane_cells import SEGMENTS_UP_TO
from s2rtui.drawing.plane_marks import Segments
from s2rtui.drawing.points import Grid, drawn_segments
from tests.charts.examples import BOUNDS, draw_map, map_input, map_place, points_of

SIZE = (80, 26)
LEFT_HALF = np.array([[1, 1, 0, 0]] * 2)
"""Mask in which only the left half of the map is visible."""


def cell_at(view: MapInput, x: float, y: float) -> tuple[int, int]:
    """Row and column of a point on a map."""
    return map_place(map_drawing(view), SIZE).cells([[x, y]])[0]


@pytest.mark.parametrize(
    "seen", [LEFT_HALF, LEFT_HALF.astype(bool), np.where(LEFT_HALF, 3.5, np.nan)]
)
def test_unseen_floor_alone_is_dimmed_and_the_points_stay(seen):
    view = map_input(cursor=None, rooms=())
    dimmed = map_input(cursor=None, rooms=(), seen=seen)
    before, after = draw_map(view, SIZE), draw_map(dimmed, SIZE)
    visible, hidden = (cell_at(dimmed, *at) for at in ((5.0, 3.0), (15.0, 5.0)))
    assert (after.bg[visible] == before.bg[visible]).all()
    expected = mix(before.bg[hidden], np.array(DARK.background), DIMMED)
    assert (np.abs(after.bg[hidden].astype(int) - expected) <= 1).all()
    assert (after.char == "●").sum() == (before.char == "●").sum() > 5


def test_a_room_name_in_a_full_room_is_drawn_in_front_of_the_points():
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


def test_bounds_can_be_zoomed_and_panned():
    near = zoomed(BOUNDS, 2.0, (0.0, 0.0))
    assert (near.x0, near.y0, near.x1, near.y1) == (0, 0, 10, 5)
    moved = panned(near, 0.5, 1.0, y_down=False)
    assert (moved.x0, moved.y0) == (5, -5)


def test_selected_points_are_coloured_and_others_grey():
    view = map_input(plan=None, heat=None, rooms=(), cursor=None)
    canvas = draw_map(view, SIZE)
    selected, other = (cell_at(view, *points_of(view)[iid]) for iid in (59, 20))
    assert canvas.char[selected] == "●"
    assert tuple(canvas.fg[selected]) == tuple(legible(turbo([1.0]), DARK)[0])
    assert 0x2800 < ord(canvas.char[other]) <= 0x28FF
    assert tuple(canvas.fg[other]) == DARK.unselected


def lines_of(view: MapInput, viewport: Bounds | None = None) -> Any:
    """The iids whose error lines a map in `SIZE` draws."""
    drawing = map_drawing(view, viewport)
    place = drawing_layout(drawing, SIZE, DEFAULT_OPTIONS).plots[0]
    (mark, _) = (mark for mark in place.plot.marks if isinstance(mark, Segments))
    grid = Grid(place.plot.x, place.plot.y, place.width, place.rows)
    return drawn_segments(mark, grid, SEGMENTS_UP_TO)


def test_large_selections_draw_only_the_cursor_s_error_lines():
    view = map_input(mode="full", selected=np.ones(60, dtype=np.bool_), cursor=8)
    assert lines_of(view).tolist() == [8]
    assert f"error lines for up to {SEGMENTS_UP_TO}" in "\n".join(draw_map(view, (100, 30)).lines())


def test_zooming_in_draws_the_error_lines_of_visible_instances():
    view = map_input(mode="full", selected=np.ones(60, dtype=np.bool_), cursor=None)
    near = Bounds(16.0, 3.5, 18.0, 6.5)
    frame = map_place(map_drawing(view, near), SIZE).frame
    cells = frame.to_cells(points_of(view))
    visible = ((cells >= 0) & (cells < (frame.width, frame.height // 2))).all(axis=1) & view.valid
    assert 0 < visible.sum() <= SEGMENTS_UP_TO
    assert lines_of(view, near).tolist() == np.flatnonzero(visible).tolist()


def signed_map(**changes: object) -> MapInput:
    """A map whose left, middle and right thirds have heat -1, 0 and 1 without other marks."""
    heat = np.repeat([-1.0, 0.0, 1.0], 10)[None].repeat(15, axis=0)
    plain = {"plan": None, "rooms": (), "cursor": None, "heat_is_signed": True}
    return map_input(**{"heat": heat, **plain, **changes})


def thirds(view: MapInput, pixels: np.ndarray) -> list[list[int]]:
    """The colours of the thirds of an image (h, w, 3) that the map fills."""
    frame = map_place(map_drawing(view), SIZE).frame
    places = frame.to_cells([[x, 9.0] for x in (3.0, 10.0, 17.0)])
    scale = pixels.shape[1] / frame.width
    return [pixels[int(y * scale / 2), int(x * scale)].tolist() for x, y in places]


def is_green(pixels: np.ndarray) -> np.ndarray:
    """Where the middle of a scale without sign would be drawn."""
    red, green, blue = np.moveaxis(pixels.astype(int), -1, 0)
    return (green > red + 40) & (green > blue + 40)


NO_POINTS = {"valid": np.zeros(60, np.bool_), "selected": np.zeros(60, np.bool_), "value_label": ""}


def test_signed_heat_on_the_map_is_blue_and_orange_and_transparent_at_0():
    view = signed_map(**NO_POINTS)
    canvas, place = draw_map(view, SIZE), map_place(map_drawing(view), SIZE)
    rows = np.repeat(canvas.bg[:, place.x : place.x + place.frame.width], 2, axis=0)
    low, zero, high = thirds(view, np.asarray(rows[place.y :]))
    assert low[2] > low[0] + 80
    assert tuple(zero) == DARK.background
    assert high[0] > high[2] + 80
    assert not is_green(canvas.fg).any()
    assert not is_green(canvas.bg).any()
    assert floor_heat_scale(np.full((15, 30), -0.5), True) == (-0.5, 0.5)


def test_signed_heat_without_colours_differs_by_its_glyphs():
    for ascii in (True, False):
        options = RenderOptions(mode=ColourMode.NONE, ascii=ascii)
        lines = draw_map(signed_map(), SIZE, options).lines()
        assert "MMMM" in lines[2]
        assert "%%%%" in lines[2]
        assert lines[2].index("MMMM") < lines[2].index("%%%%")


def test_signed_heat_on_paper_is_blue_and_orange_and_transparent_at_0():
    shares = np.array([0.0, 0.5, 1.0, np.nan])
    assert map_opacity(shares, True).tolist() == [0.86, 0.0, 0.86, 0.0]
    assert map_opacity(shares, False)[0] > 0
    page = draw_paper(map_drawing(signed_map(**NO_POINTS)), (600, 400), LIGHT)
    pixels = np.asarray(Image.open(BytesIO(page)).convert("RGB")).astype(int)
    assert not is_green(pixels).any()
    excess = pixels[..., 2] - pixels[..., 0]
    blue, orange = (np.flatnonzero((sign * excess > 80).sum(axis=0) > 150) for sign in (1, -1))
    middle = pixels[100, blue.max() + 2 : orange.min() - 1]
    assert len(middle) > 100
    assert (middle == LIGHT.background).all()


def test_sampled_image_rows_follow_the_y_direction():
    image = np.array([[1.0, 2.0], [3.0, np.nan]])
    square = Bounds(0, 0, 2, 2)
    frame = MapFrame(0.0, 0.0, 0.5, 4, 4, True)
    assert sample(image, square, frame, True)[[0, 0, 3], [0, 3, 0]].tolist() == [1, 2, 3]
    assert np.isnan(sample(image, square, frame, True)[3, 3])
    assert sample(image, square, frame, False)[0, 0] == 3
