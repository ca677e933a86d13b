"""Maps in true pixels show what their cells show."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rtui.canvas import DARK, ColourMode, InlineImage, Pixels, RenderOptions
from s2rtui.canvas.pixel_marks import diamond, disc, draw_dots_by_level, highest_at, hollow, stamped
from s2rtui.charts.compare.terminal import draw_compare
from s2rtui.charts.map.terminal import draw_map
from tests.charts.examples import compare_input, map_input

SIZE = (60, 24)
CELL = (10, 20)


def picture(image: InlineImage) -> Pixels:
    return image.pixels((image.height * CELL[1], image.width * CELL[0]))


def map_picture(**changes: Any) -> tuple[InlineImage, Pixels]:
    (image,) = draw_map(map_input(**changes), SIZE).images
    return image, picture(image)


def has(pixels: Pixels, colour: tuple[int, int, int]) -> bool:
    return bool((pixels == np.array(colour)).all(axis=-1).any())


def test_every_dot_of_the_cells_is_a_dot_of_its_colour_in_the_picture() -> None:
    view = map_input(cursor=None)
    canvas = draw_map(view, SIZE)
    (image,) = canvas.images
    pixels = picture(image)
    box = canvas.char[image.y : image.y + image.height, image.x : image.x + image.width]
    found = np.argwhere(box == "●")
    assert len(found) > 3
    for row, column in found.tolist():
        colour = canvas.fg[image.y + row, image.x + column].tolist()
        cell = pixels[row * 20 : row * 20 + 20, column * 10 : column * 10 + 10]
        assert has(cell, tuple(colour))


@pytest.mark.parametrize(
    ("mode", "roles"),
    [("colour", ("cursor",)), ("glyph", ("sim", "real", "truth")), ("full", ("sim", "real"))],
)
def test_the_picture_shows_the_marks_of_each_mode(mode: str, roles: tuple[str, ...]) -> None:
    _, pixels = map_picture(mode=mode)
    for role in roles:
        assert has(pixels, getattr(DARK, role))


def test_the_picture_of_a_comparison_shows_the_cursor() -> None:
    data = compare_input(cursor=int(np.flatnonzero(compare_input().valid)[0]))
    (image,) = draw_compare(data, SIZE).images
    assert has(picture(image), DARK.cursor)


@pytest.mark.parametrize(
    "options", [RenderOptions(ascii=True), RenderOptions(mode=ColourMode.ANSI)]
)
def test_terminals_of_few_colours_get_no_picture(options: RenderOptions) -> None:
    assert draw_map(map_input(), SIZE, options).images == []


def test_moving_the_cursor_changes_the_key_and_a_brush_does_not() -> None:
    data = map_input()
    first, same, moved = (
        draw_map(view, SIZE).images[0].content_key
        for view in (data, map_input_like(data), map_input_like(data, cursor=5))
    )
    assert first == same
    assert first != moved


def map_input_like(data: Any, **changes: Any) -> Any:
    from dataclasses import replace

    from s2rtui.canvas import Mark

    return replace(data, mark=Mark("map", ((0.0, 0.0), (2.0, 2.0))), **changes)


def test_a_brush_stays_text_on_the_picture() -> None:
    (image,) = draw_map(map_input_like(map_input()), SIZE).images
    assert image.text is not None
    assert image.text.any()
    assert not image.text.all()


# --- marks ---------------------------------------------------------------------------------------

places = st.lists(
    st.tuples(st.integers(-3, 33), st.integers(-3, 23), st.integers(0, 9)), max_size=30
)


@given(places, st.sampled_from([disc(3), diamond(2), hollow(disc(4)), disc(0.5)]))
def test_stamps_show_the_highest_level(marks: list[tuple[int, int, int]], shape: Any) -> None:
    points = np.array([mark[:2] for mark in marks], dtype=np.float64).reshape(-1, 2)
    top = highest_at(points, [level for *_, level in marks], (20, 30))
    drawn, size = stamped(top, shape), shape.shape[0] // 2
    expected = np.full((20, 30), -1)
    for x, y, level in marks:
        if not (0 <= x < 30 and 0 <= y < 20):
            continue
        for down, across in np.argwhere(shape) - size:
            row, column = y + down, x + across
            if 0 <= row < 20 and 0 <= column < 30:
                expected[row, column] = max(expected[row, column], level)
    np.testing.assert_array_equal(drawn, expected)


def test_an_outline_surrounds_a_dot() -> None:
    image = np.full((15, 15, 3), 90, dtype=np.uint8)
    top = highest_at(np.array([[7.0, 7.0]]), [0], (15, 15))
    draw_dots_by_level(image, top, np.array([[255, 0, 0]], dtype=np.uint8), disc(3), (0, 0, 0))
    row = image[7, :, 0].tolist()
    assert row[3:12] == [0, 255, 255, 255, 255, 255, 255, 255, 0]
    assert row[2] == row[12] == 90
