"""The canvas: clipping, cells, wide characters, images and dots in the correct cells."""

import numpy as np
import pytest
from rich.cells import cell_len

from s2rtui.canvas import Canvas, RenderOptions
from s2rtui.canvas.colour import ANSI_16, diverging, to_16, to_256, turbo
from s2rtui.canvas.fit_text import fit_text, wrap_text
from s2rtui.canvas.raster import braille_bits, dot_grid, draw_braille, resample


def test_text_is_clipped_aligned_and_has_no_control_characters():
    canvas = Canvas(4, 2)
    canvas.text(-2, 0, "abcdef")
    canvas.text(2, 1, "xyz")
    canvas.text(0, 5, "nowhere")
    assert canvas.lines() == ["cdef", "  xy"]
    canvas = Canvas(9, 3)
    canvas.text(9, 0, "right", align="right")
    canvas.text(4, 1, "mid", align="center")
    canvas.text(0, 2, "a\x1b[31m")
    assert canvas.lines()[:2] == ["    right", "   mid   "]
    assert "\x1b" not in canvas.lines()[2]


def test_colours_of_16_and_256_keep_the_hue():
    cube = np.array([[0, 95, 135], [255, 0, 215], [8, 8, 8], [238, 238, 238]], dtype=np.uint8)
    assert to_256(cube).tolist() == [16 + 6 + 2, 16 + 180 + 4, 232, 255]
    assert to_16(np.array([[255, 102, 94]], dtype=np.uint8))[0] == 9
    assert to_16(ANSI_16.astype(np.uint8)).tolist() == list(range(16))


def test_turbo_goes_from_blue_to_red_and_diverging_is_neutral_at_zero():
    low, middle, high = turbo([0.1, 0.5, 0.95]).astype(int)
    assert low.argmax() == 2
    assert middle.argmax() == 1
    assert high.argmax() == 0
    assert (turbo([-1, 2, np.nan]) == turbo([0, 1, 0])).all()
    colours = diverging([-1, 0, 1], middle=(236, 236, 236))
    assert colours[1].tolist() == [236, 236, 236]
    assert colours[0, 2] > colours[0, 0]
    assert colours[2, 0] > colours[2, 2]


def cells_of(canvas: Canvas) -> list[int]:
    return [cell_len(line) for line in canvas.lines()]


@pytest.mark.parametrize("x", range(-2, 8))
def test_no_half_of_a_wide_character_remains(x):
    options = RenderOptions()
    for draw in (
        lambda canvas: canvas.put(x, 0, "#"),
        lambda canvas: canvas.text(x, 0, "界"),
        lambda canvas: canvas.text(x, 0, "ab"),
        lambda canvas: canvas.hline(x, x + 1, 0),
        lambda canvas: canvas.vline(x, 0, 0),
        lambda canvas: canvas.paste(Canvas(1, 1, options), x, 0),
        lambda canvas: canvas.paste(wide_text(3), x, 0),
        lambda canvas: canvas.paste(wide_text(3, 1), x, 0),
    ):
        for start in (0, 1):
            canvas = wide_text(7, start)
            draw(canvas)
            assert cells_of(canvas) == [7]


def wide_text(width: int, start: int = 0) -> Canvas:
    canvas = Canvas(width, 1)
    canvas.text(start, 0, "所有世界")
    return canvas


@pytest.mark.parametrize(
    ("text", "width", "fitted"),
    [
        ("median 0.018", 12, "median 0.018"), ("median 0.018", 11, "median"), ("-10.5", 4, ""),
        ("peak 12k more", 7, "peak"), ("peak 12k more", 9, "peak 12k"), ("所有世界", 5, "所有"),
        ("所有 12", 6, "所有"),
    ],
)  # fmt: skip
def test_fitted_text_has_no_part_of_a_number(text, width, fitted):
    assert fit_text(text, width) == fitted
    assert cell_len(fit_text(text, width, "…")) <= width


def test_wrapped_text_counts_wide_characters_and_divides_only_longer_words():
    assert wrap_text("所有 1.5 m (0.9 to 2)", 9, "  ") == ["所有 1.5", "  m (0.9", "  to 2)"]
    assert wrap_text("所有世界 re-runs", 5) == ["所有", "世界", "re-ru", "ns"]
    assert wrap_text("  x=-1,\u00a0y=-0.5", 8) == ["  x=-1,", "y=-0.5"]


def test_resampling_averages_the_known_pixels_or_takes_the_nearest():
    image = np.arange(16, dtype=np.float32).reshape(4, 4)
    assert resample(image, 2, 2).tolist() == [[2.5, 4.5], [10.5, 12.5]]
    assert resample(image, 1, 1)[0, 0] == pytest.approx(7.5)
    small = resample(np.array([[1.0, np.nan], [3.0, np.nan]]), 1, 2)
    assert small[0, 0] == 2.0
    assert np.isnan(small[0, 1])
    assert resample(np.array([[1, 2]]), 2, 4).tolist() == [[1, 1, 2, 2]] * 2


def test_dots_are_braille_and_those_outside_are_dropped():
    dots = np.zeros((4, 4), dtype=np.bool_)
    dots[0, 0] = dots[3, 1] = dots[3, 2] = True
    assert braille_bits(dots).tolist() == [[0x81, 0x40]]
    canvas = Canvas(2, 1)
    draw_braille(canvas, dots, canvas.theme.text)
    assert canvas.lines() == ["⢁⡀"]
    dots = dot_grid(np.array([-0.1, 0.6, 9.0]), np.array([0.0, 0.9, 0.0]), 2, 1)
    assert np.argwhere(dots).tolist() == [[3, 1]]
