"""Images and dots are drawn in the correct cells."""

from __future__ import annotations

import numpy as np
import pytest

from s2rtui.canvas import Canvas, ColourMode, RenderOptions
from s2rtui.canvas.colour import contrast
from s2rtui.canvas.raster import (
    braille_bits,
    dot_grid,
    draw_braille,
    draw_half_blocks,
    draw_image,
    limit_ground,
    resample,
)


def test_downsampling_averages_the_covered_pixels() -> None:
    image = np.arange(16, dtype=np.float32).reshape(4, 4)
    assert resample(image, 2, 2).tolist() == [[2.5, 4.5], [10.5, 12.5]]
    assert resample(image, 1, 1)[0, 0] == pytest.approx(7.5)


def test_downsampling_ignores_missing_values() -> None:
    image = np.array([[1.0, np.nan], [3.0, np.nan]])
    small = resample(image, 1, 2)
    assert small[0, 0] == 2.0
    assert np.isnan(small[0, 1])


def test_upsampling_uses_the_nearest_pixel() -> None:
    assert resample(np.array([[1, 2]]), 2, 4).tolist() == [[1, 1, 2, 2]] * 2


def test_half_blocks_combine_two_rows_and_are_clipped() -> None:
    pixels = np.arange(4 * 3 * 3, dtype=np.uint8).reshape(4, 3, 3)
    canvas = Canvas(3, 3)
    draw_half_blocks(canvas, -1, 2, pixels)
    assert canvas.char[2].tolist() == ["▀", "▀", " "]
    assert canvas.fg[2, 0].tolist() == pixels[0, 1].tolist()
    assert canvas.bg[2, 0].tolist() == pixels[1, 1].tolist()


def test_braille_dots_map_to_unicode_bits() -> None:
    dots = np.zeros((4, 4), dtype=np.bool_)
    dots[0, 0] = dots[3, 1] = dots[3, 2] = True
    assert braille_bits(dots).tolist() == [[0x81, 0x40]]
    canvas = Canvas(2, 1)
    draw_braille(canvas, dots, canvas.theme.text)
    assert canvas.lines() == ["⢁⡀"]


def test_dots_outside_the_grid_are_dropped() -> None:
    dots = dot_grid(np.array([-0.1, 0.6, 9.0]), np.array([0.0, 0.9, 0.0]), 2, 1)
    assert np.argwhere(dots).tolist() == [[3, 1]]


def test_a_glyph_gets_a_ground_that_it_stands_out_from_and_an_image_stays() -> None:
    canvas = Canvas(3, 1)
    draw_half_blocks(canvas, 0, 0, np.full((2, 3, 3), 200, dtype=np.uint8))
    canvas.put(1, 0, "●", canvas.theme.real)
    limit_ground(canvas)
    assert contrast(canvas.fg[0, 1], canvas.bg[0, 1]) >= 3
    assert canvas.bg[0, ::2].tolist() == [[200] * 3] * 2


@pytest.mark.parametrize(
    "options", [RenderOptions(ascii=True), RenderOptions(mode=ColourMode.NONE)]
)
def test_brightness_is_drawn_as_density_without_half_blocks(options: RenderOptions) -> None:
    pixels = np.zeros((2, 3, 3), dtype=np.uint8)
    pixels[:, 1], pixels[:, 2] = 128, 255
    canvas = Canvas(3, 1, options)
    draw_image(canvas, 0, 0, pixels)
    shades = options.glyphs.shades
    assert canvas.lines()[0] == shades[0] + shades[len(shades) // 2] + shades[-1]
