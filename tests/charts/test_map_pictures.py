"""Maps in true pixels show what their cells show, stand out and are resampled by area."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bench.support.map_contrast import measure
from s2rstore.records import Bounds
from s2rtools.synthetic_world.floor_plan import BUILDING_SIZE
from s2rtools.synthetic_world.world import World
from s2rtui.analysis.map_frame import MapFrame, sample
from s2rtui.canvas import (
    DARK,
    THEMES,
    BrushShape,
    ColourMode,
    InlineImage,
    Pixels,
    RenderOptions,
    legible,
    turbo,
)
from s2rtui.canvas.colour import contrast, luminance, with_luminance
from tests.charts.examples import draw_map, map_input

SIZE = (60, 24)
CELL = (10, 20)


def picture(image: InlineImage) -> Pixels:
    return image.pixels((image.height * CELL[1], image.width * CELL[0]))


def map_picture(**changes: Any) -> tuple[InlineImage, Pixels]:
    (image,) = draw_map(map_input(**changes), SIZE).images
    return image, picture(image)


def has(pixels: Pixels, colour: tuple[int, int, int]) -> bool:
    return bool((pixels == np.array(colour)).all(axis=-1).any())


def test_every_sign_of_the_cells_is_a_mark_of_its_colour_in_the_picture():
    canvas = draw_map(map_input(cursor=None), SIZE)
    (image,) = canvas.images
    pixels = picture(image).astype(int)
    box = canvas.char[image.y : image.y + image.height, image.x : image.x + image.width]
    found = np.argwhere(box == "●")
    assert len(found) > 3
    for row, column in found.tolist():
        colour = canvas.fg[image.y + row, image.x + column]
        cell = pixels[row * 20 : row * 20 + 20, column * 10 : column * 10 + 10]
        assert np.abs(cell - colour).sum(axis=-1).min() < 120


@pytest.mark.parametrize(
    ("mode", "roles"),
    [("colour", ("cursor",)), ("glyph", ("sim", "real", "truth")), ("full", ("sim", "real"))],
)
def test_the_picture_shows_the_marks_of_each_mode(mode, roles):
    _, pixels = map_picture(mode=mode)
    for role in roles:
        assert has(pixels, getattr(DARK, role))


@pytest.mark.parametrize(
    "options", [RenderOptions(ascii=True), RenderOptions(mode=ColourMode.ANSI)]
)
def test_terminals_of_few_colours_get_no_picture(options):
    assert draw_map(map_input(), SIZE, options).images == []


def test_a_brush_stays_text_on_the_picture_and_only_the_cursor_changes_the_key():
    data, brush = map_input(), BrushShape("map", ((0.0, 0.0), (2.0, 2.0)))
    (image,) = draw_map(data, SIZE, brush=brush).images
    assert image.text is not None
    assert image.text.any()
    assert not image.text.all()
    moved = replace(data, cursor=5)
    keys = [
        draw_map(view, SIZE, brush=mark).images[0].content_key
        for view, mark in ((data, None), (data, brush), (moved, brush))
    ]
    assert keys[0] == keys[1] != keys[2]


def test_names_and_numbers_stay_text_on_the_picture():
    for changes in ({}, {"mode": "glyph", "selected": np.ones(60, dtype=np.bool_)}):
        canvas = draw_map(map_input(**changes), SIZE)
        (image,) = canvas.images
        box = canvas.char[image.y : image.y + image.height, image.x : image.x + image.width]
        text = "".join(box[image.text].tolist())
        assert "hall" in text
        assert any(letter in "23456789" for letter in text) == bool(changes)


COLOURED = (ColourMode.TRUECOLOR, ColourMode.PALETTE, ColourMode.ANSI)
BOUNDS = Bounds(0.0, 0.0, BUILDING_SIZE, BUILDING_SIZE)
TURBO = turbo(np.linspace(0, 1, 256))


@pytest.fixture(scope="module")
def demo_plan() -> np.ndarray:
    return World(1).renderer({}).plan(1056)


@pytest.mark.parametrize("theme", THEMES.values(), ids=lambda theme: theme.name)
@pytest.mark.parametrize("mode", COLOURED, ids=lambda mode: mode.value)
def test_walls_and_points_of_the_demo_stand_out_and_points_from_heat(demo_plan, theme, mode):
    ramp = np.linspace(0, 1, 64)
    for heat in (None, np.add.outer(ramp, ramp)):
        ratios = measure(demo_plan, BOUNDS, RenderOptions(theme, mode), heat=heat)
        assert len(ratios.selected) > 400
        assert ratios.selected.min() >= 3
        assert ratios.unselected.min() >= 2.5
        if heat is None:
            assert len(ratios.walls) > 300
            assert ratios.walls.min() >= 3


def test_contrast_is_that_of_wcag():
    assert contrast((0, 0, 0), (255, 255, 255)) == pytest.approx(21)
    assert contrast((119, 119, 119), (255, 255, 255)) == pytest.approx(4.48, abs=0.005)
    assert luminance((255, 0, 0)) == pytest.approx(0.2126, abs=1e-4)


@pytest.mark.parametrize("limits", [(0.3, 1.0), (0.0, 0.06), (0.1, 0.1)])
def test_colours_are_brought_between_luminances_and_keep_their_hue(limits):
    colours = np.random.default_rng(2).integers(0, 256, (500, 3)).astype(np.uint8)
    changed = with_luminance(colours, *limits)
    at = luminance(changed)
    assert (at >= limits[0] - 0.01).all()
    assert (at <= limits[1] + 0.01).all()
    hued = np.ptp(changed.astype(int), axis=1) > 40
    assert (colours.argmax(axis=1) == changed.argmax(axis=1))[hued].mean() > 0.97


@pytest.mark.parametrize("theme", THEMES.values(), ids=lambda theme: theme.name)
def test_texts_and_marks_are_legible_on_the_page(theme):
    for name in ("text", "muted", "sim", "real", "both", "truth", "cursor"):
        assert contrast(getattr(theme, name), theme.background) >= 4.5, name
    assert contrast(theme.unselected, theme.background) >= 2.5
    assert contrast(legible(TURBO, theme), theme.background).min() >= 3
    assert contrast(theme.wall, with_luminance(TURBO, *theme.floor)).min() >= 3


def exact_mean(image: np.ndarray, bounds: Bounds, box: Bounds) -> float:
    """The mean of an image (H, W) that covers `bounds` over a box, without NaN.

    Where they overlap by rounding alone, there is none.
    """
    rows, columns = image.shape
    across = np.linspace(bounds.x0, bounds.x1, columns + 1)
    down = np.linspace(bounds.y0, bounds.y1, rows + 1)
    wide = np.clip(np.minimum(across[1:], box.x1) - np.maximum(across[:-1], box.x0), 0, None)
    high = np.clip(np.minimum(down[1:], box.y1) - np.maximum(down[:-1], box.y0), 0, None)
    weight = np.where(np.isnan(image), 0, np.multiply.outer(high, wide))
    total = weight.sum()
    return float((weight * np.nan_to_num(image)).sum() / total) if total > 1e-12 else np.nan


@given(st.integers(1, 40), st.integers(1, 40), st.floats(0.05, 0.9), st.booleans(), st.booleans())
@example(31, 29, 0.625, False, False)
@example(1, 1, 0.35, False, False)
def test_each_pixel_is_the_mean_of_its_area(rows, columns, pitch, y_down, of_numbers):
    rng = np.random.default_rng(rows * 41 + columns)
    bounds, frame = Bounds(0.0, 0.0, 3.0, 2.0), MapFrame(-0.3, 0.7, pitch, 5, 4, y_down)
    is_interpolated = not of_numbers and max(rows / 2.0, columns / 3.0) * pitch >= 8
    if is_interpolated:  # a ramp, whose mean within a block is known to half its rise
        image = np.add.outer(np.arange(rows) / rows, np.arange(columns) / columns)
        image = np.round(127.5 * image).astype(np.uint8)
        tolerance = 1 + 127.5 * (pitch / 2.0 + pitch / 3.0) / 4
    else:
        image = rng.integers(0, 256, (rows, columns)).astype(np.uint8)
        tolerance = 2e-3
    if of_numbers:
        image = np.where(rng.random(image.shape) < 0.2, np.nan, image).astype(np.float32)
    shown = sample(image, bounds, frame, True)
    for row, column in np.ndindex(4, 5):
        x, y = -0.3 + column * pitch, 0.7 + (row if y_down else -row - 1) * pitch
        expected = exact_mean(image, bounds, Bounds(x, y, x + pitch, y + pitch))
        np.testing.assert_allclose(shown[row, column], expected, rtol=1e-4, atol=tolerance)


def test_two_maps_of_one_size_show_the_same_ground():
    plan = np.random.default_rng(1).integers(0, 256, (300, 300, 3)).astype(np.uint8)
    nobody = np.zeros(len(map_input().selected), dtype=np.bool_)
    view = map_input(plan=plan, selected=nobody, cursor=None)
    first, second = (
        draw_map(replace(view, values=values), (50, 24))
        for values in (np.zeros(len(nobody)), np.linspace(0, 9, len(nobody)))
    )
    np.testing.assert_array_equal(first.bg[:18, 5:], second.bg[:18, 5:])
    np.testing.assert_array_equal(first.fg[1:18, 5:], second.fg[1:18, 5:])
