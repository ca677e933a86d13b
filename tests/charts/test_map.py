"""The map view: frame, points, heatmap, floor plan and legend."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from s2rstore.records import Bounds
from s2rtui.analysis.map_frame import fit_frame, panned, sample, zoomed
from s2rtui.canvas import DARK, ColourMode, RenderOptions, heading_arrow
from s2rtui.canvas.colour import legible, turbo
from s2rtui.canvas.render_options import ASCII, UNICODE
from s2rtui.charts.map.model import LINES_UP_TO, iids_with_error_lines
from s2rtui.charts.map.terminal import draw_map, map_layout
from s2rtui.charts.shared.base_map_model import MapInput, map_model, sorted_by_value
from s2rtui.charts.shared.heat_colours import heat_ramp, map_opacity
from tests.charts.examples import BOUNDS, map_input

SIZE = (80, 26)


def test_the_frame_keeps_the_aspect_ratio_and_centres_the_area() -> None:
    frame = fit_frame(BOUNDS, 100, 100, True)
    assert frame.pitch == pytest.approx(0.2)
    assert frame.extent.y0 == pytest.approx(-5)
    assert frame.to_cells([[0.0, 5.0]]).tolist() == [[0.0, 25.0]]


@pytest.mark.parametrize("y_down", [True, False])
def test_the_frame_converts_coordinates_in_both_directions(y_down: bool) -> None:
    frame = fit_frame(BOUNDS, 40, 20, y_down)
    upper, lower = frame.to_cells([[5, 2], [5, 8]])[:, 1]
    assert (upper < lower) == y_down
    x, y = frame.to_world(7, 3)
    assert frame.to_cells([[x, y]])[0] == pytest.approx([7.5, 3.5])


def test_bounds_can_be_zoomed_and_panned() -> None:
    near = zoomed(BOUNDS, 2.0, (0.0, 0.0))
    assert (near.x0, near.y0, near.x1, near.y1) == (0, 0, 10, 5)
    moved = panned(near, 0.5, 1.0, y_down=False)
    assert (moved.x0, moved.y0) == (5, -5)


def test_sampled_image_rows_follow_the_y_direction() -> None:
    image = np.array([[1.0, 2.0], [3.0, np.nan]])
    square = Bounds(0, 0, 2, 2)
    frame = fit_frame(square, 4, 4, True)
    assert sample(image, square, frame, True)[[0, 0, 3], [0, 3, 0]].tolist() == [1, 2, 3]
    assert np.isnan(sample(image, square, frame, True)[3, 3])
    assert sample(image, square, frame, False)[0, 0] == 3


def test_the_model_sorts_by_value_and_excludes_invalid_instances() -> None:
    view = map_input(cursor=3)
    model = map_model(view)
    assert sorted_by_value(view, model)[0].tolist() == list(range(45, 60))
    assert (model.highlighted, model.others) == (15, 44)
    assert model.cursor is None


def test_selected_points_are_coloured_and_others_grey() -> None:
    view = map_input(floor_plan=None, heat=None, rooms=(), cursor=None)
    canvas = draw_map(view, SIZE)
    layout = map_layout(view, SIZE)
    column, row = np.floor(layout.frame.to_cells(view.truth)[59]).astype(int)
    column += layout.x
    assert canvas.char[row, column] == "●"
    assert tuple(canvas.fg[row, column]) == tuple(legible(turbo([1.0]), DARK)[0])
    column, row = np.floor(layout.frame.to_cells(view.truth)[20]).astype(int)
    assert 0x2800 < ord(canvas.char[row, column + layout.x]) <= 0x28FF
    assert tuple(canvas.fg[row, column + layout.x]) == DARK.unselected


def test_digits_replace_colours() -> None:
    view = map_input(floor_plan=None, heat=None, rooms=(), cursor=None)
    options = RenderOptions(mode=ColourMode.NONE)
    canvas, layout = draw_map(view, SIZE, options), map_layout(view, SIZE, None, options)
    column, row = np.floor(layout.frame.to_cells(view.truth)[59]).astype(int)
    assert canvas.char[row, column + layout.x] == "9"


def test_full_mode_shows_predictions_truth_cursor_and_error_lines() -> None:
    selected = np.zeros(60, dtype=np.bool_)
    selected[[10, 30]] = True
    view = map_input(mode="full", selected=selected, cursor=30, heat=None, rooms=())
    text = "\n".join(draw_map(view, SIZE).lines()[:20])
    for glyph in (UNICODE.sim, UNICODE.real, UNICODE.truth, UNICODE.cursor):
        assert glyph in text
    assert iids_with_error_lines(view, map_model(view)).tolist() == [10, 30]
    assert any(arrow in text for arrow in UNICODE.arrows)


def test_large_selections_draw_only_the_cursor_s_error_lines() -> None:
    view = map_input(mode="full", selected=np.ones(60, dtype=np.bool_), cursor=8)
    model = map_model(view)
    assert iids_with_error_lines(view, model).tolist() == [8]
    assert f"error lines for up to {LINES_UP_TO}" in "\n".join(draw_map(view, (100, 30)).lines())


def test_zooming_in_draws_the_error_lines_of_visible_instances() -> None:
    view = map_input(mode="full", selected=np.ones(60, dtype=np.bool_), cursor=None)
    near = Bounds(16.0, 3.5, 18.0, 6.5)
    frame = map_layout(view, SIZE, near).frame
    cells = frame.to_cells(view.truth)
    visible = ((cells >= 0) & (cells < (frame.width, frame.height // 2))).all(axis=1) & view.valid
    assert 0 < visible.sum() <= LINES_UP_TO
    assert (
        iids_with_error_lines(view, map_model(view), frame).tolist()
        == np.flatnonzero(visible).tolist()
    )


@pytest.mark.parametrize(
    ("degrees", "y_down", "arrow", "step"),
    [
        (0, True, "→", (1, 0)),
        (90, True, "↓", (0, 1)),
        (90, False, "↑", (0, -1)),
        (-135, True, "↖", (-1, -1)),
    ],
)
def test_heading_arrows_follow_the_y_direction(
    degrees: float, y_down: bool, arrow: str, step: tuple[int, int]
) -> None:
    assert heading_arrow(np.radians(degrees), y_down, UNICODE) == (arrow, *step)


def test_both_glyph_sets_have_eight_arrows() -> None:
    assert len(ASCII.arrows) == len(UNICODE.arrows) == 8


def test_heat_colours_only_cells_with_values() -> None:
    without_heat = draw_map(map_input(heat=None, cursor=None), SIZE)
    with_heat = draw_map(map_input(cursor=None), SIZE)
    layout = map_layout(map_input(), SIZE)
    column, row = layout.frame.to_cells([[5.0, 3.0]])[0].astype(int)
    assert (
        int(with_heat.bg[row, column + layout.x, 1])
        > int(without_heat.bg[row, column + layout.x, 1]) + 60
    )
    column, row = layout.frame.to_cells([[15.0, 5.0]])[0].astype(int)
    assert (with_heat.bg[row, column + layout.x] == without_heat.bg[row, column + layout.x]).all()


def test_the_floor_plan_is_drawn_dimmed() -> None:
    view = map_input(heat=None, cursor=None, rooms=())
    canvas, layout = draw_map(view, SIZE), map_layout(view, SIZE)
    right = layout.frame.to_cells([[15.0, 5.0]])[0].astype(int)
    left = layout.frame.to_cells([[5.0, 5.0]])[0].astype(int)
    bright = canvas.bg[right[1], right[0] + layout.x].astype(int).sum()
    dark = canvas.bg[left[1], left[0] + layout.x].astype(int).sum()
    assert dark < bright < 3 * 170


def test_the_legend_names_values_heat_and_scale() -> None:
    text = "\n".join(draw_map(map_input(), (100, 30)).lines())
    assert "shift" in text
    assert "heat" in text
    assert " m" in text
    assert "not selected" in text
    assert "x m" in text


def test_a_viewport_enlarges_the_map() -> None:
    near = map_layout(map_input(), SIZE, Bounds(8, 4, 12, 6)).frame
    assert near.pitch < map_layout(map_input(), SIZE).frame.pitch / 2


def test_empty_selections_and_missing_values_can_be_drawn() -> None:
    none_selected = np.zeros(60, dtype=np.bool_)
    missing = np.full(60, np.nan)
    for mode in ("colour", "glyph", "full"):
        view = map_input(
            valid=none_selected, values=missing, mode=mode, heat=np.full((3, 3), np.nan)
        )
        draw_map(view, SIZE)
        draw_map(map_input(values=missing, mode=mode, truth=np.full((60, 2), np.nan)), SIZE)


def signed_map(**changes: object) -> MapInput:
    """A map whose left, middle and right thirds have heat -1, 0 and 1 without other marks."""
    heat = np.repeat([-1.0, 0.0, 1.0], 10)[None].repeat(15, axis=0)
    plain = {"floor_plan": None, "rooms": (), "cursor": None, "heat_is_signed": True}
    return map_input(**{"heat": heat, **plain, **changes})


def thirds(view: MapInput, pixels: NDArray[np.uint8]) -> list[list[int]]:
    """The colours of the thirds of an image (h, w, 3) that the map fills."""
    frame = map_layout(view, SIZE).frame
    places = frame.to_cells([[x, 9.0] for x in (3.0, 10.0, 17.0)])
    scale = pixels.shape[1] / frame.width
    return [pixels[int(y * scale / 2), int(x * scale)].tolist() for x, y in places]


def test_signed_heat_on_the_map_is_blue_and_orange_and_transparent_at_0() -> None:
    view = signed_map()
    canvas, layout = draw_map(view, SIZE), map_layout(view, SIZE)
    rows = np.repeat(canvas.bg[:, layout.x : layout.x + layout.frame.width], 2, axis=0)
    low, zero, high = thirds(view, np.asarray(rows[layout.y :]))
    assert low[2] > low[0] + 80
    assert tuple(zero) == DARK.background
    assert high[0] > high[2] + 80


def test_signed_heat_of_one_sign_keeps_its_colour() -> None:
    view = signed_map(heat=np.full((15, 30), -0.5))
    assert map_model(view).heat_range == (-0.5, 0.5)


def test_signed_heat_without_colours_differs_by_its_glyphs() -> None:
    for ascii in (True, False):
        options = RenderOptions(mode=ColourMode.NONE, ascii=ascii)
        lines = draw_map(signed_map(), SIZE, options).lines()
        assert "MMMM" in lines[2]
        assert "%%%%" in lines[2]
        assert lines[2].index("MMMM") < lines[2].index("%%%%")


def test_signed_heat_on_paper_is_transparent_at_0() -> None:
    shares = np.array([0.0, 0.5, 1.0, np.nan])
    assert map_opacity(shares, True).tolist() == [0.86, 0.0, 0.86, 0.0]
    assert map_opacity(shares, False)[0] > 0
    (blue, _, orange) = heat_ramp(True)(shares[:3]).tolist()
    assert blue[2] > blue[0]
    assert orange[0] > orange[2]
