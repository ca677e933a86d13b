"""The canvas: clipping, cells and wide characters."""

from __future__ import annotations

import numpy as np
import pytest
from rich.cells import cell_len

from s2rtui.canvas import DARK, LIGHT, Canvas, RenderOptions
from s2rtui.canvas.colour import ANSI_16, diverging, legible, luma, to_16, to_256, turbo
from s2rtui.canvas.fit_text import fit_text


def test_text_is_clipped_at_every_edge() -> None:
    canvas = Canvas(4, 2)
    canvas.text(-2, 0, "abcdef")
    canvas.text(2, 1, "xyz")
    canvas.text(0, 5, "nowhere")
    assert canvas.lines() == ["cdef", "  xy"]


def test_wide_characters_occupy_two_whole_cells() -> None:
    canvas = Canvas(4, 1)
    canvas.text(0, 0, "a界界")
    assert canvas.char[0].tolist() == ["a", "界", "", " "]
    assert canvas.lines() == ["a界 "]


def test_control_characters_are_not_drawn() -> None:
    canvas = Canvas(6, 1)
    canvas.text(0, 0, "a\x1b[31m")
    assert "\x1b" not in canvas.lines()[0]


def test_text_can_be_aligned() -> None:
    canvas = Canvas(9, 2)
    canvas.text(9, 0, "right", align="right")
    canvas.text(4, 1, "mid", align="center")
    assert canvas.lines() == ["    right", "   mid   "]


def test_boxes_and_pasted_canvases_are_drawn() -> None:
    canvas, small = Canvas(6, 4), Canvas(3, 2)
    small.text(0, 0, "xyz", DARK.real)
    canvas.box(0, 0, 6, 4, ascii=True)
    canvas.paste(small, 4, 1)
    assert canvas.lines() == ["+----+", "|   xy", "|     ", "+----+"]
    assert tuple(canvas.fg[1, 4]) == DARK.real


def test_palette_colours_map_to_themselves() -> None:
    cube = np.array([[0, 95, 135], [255, 0, 215], [8, 8, 8], [238, 238, 238]], dtype=np.uint8)
    assert to_256(cube).tolist() == [16 + 6 + 2, 16 + 180 + 4, 232, 255]


def test_sixteen_colours_keep_the_hue() -> None:
    assert to_16(np.array([[255, 102, 94]], dtype=np.uint8))[0] == 9
    assert to_16(ANSI_16.astype(np.uint8)).tolist() == list(range(16))


def test_turbo_goes_from_blue_through_green_to_red() -> None:
    low, middle, high = turbo([0.1, 0.5, 0.95]).astype(int)
    assert low.argmax() == 2
    assert middle.argmax() == 1
    assert high.argmax() == 0
    assert (turbo([-1, 2, np.nan]) == turbo([0, 1, 0])).all()


def test_diverging_is_neutral_at_zero() -> None:
    colours = diverging([-1, 0, 1], middle=(236, 236, 236))
    assert colours[1].tolist() == [236, 236, 236]
    assert colours[0, 2] > colours[0, 0]
    assert colours[2, 0] > colours[2, 2]


def test_glyph_colours_contrast_with_both_themes() -> None:
    colours = turbo(np.linspace(0, 1, 50))
    assert luma(legible(colours, DARK)).min() > 0.2
    assert luma(legible(colours, LIGHT)).max() < 0.8


def cells_of(canvas: Canvas) -> list[int]:
    return [cell_len(line) for line in canvas.lines()]


@pytest.mark.parametrize("x", range(-2, 8))
def test_no_half_of_a_wide_character_remains(x: int) -> None:
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


def test_the_canvas_shows_no_part_of_a_number() -> None:
    for width in range(1, 12):
        for align, x in (("left", 0), ("right", width), ("left", width - 3), ("right", 3)):
            canvas = Canvas(width, 1)
            canvas.text(x, 0, "m -10.5 km", align=align)
            assert ("-10.5" in canvas.lines()[0]) or not set("-105.") & set(canvas.lines()[0])


@pytest.mark.parametrize(
    ("text", "width", "fitted"),
    [
        ("median 0.018", 12, "median 0.018"),
        ("median 0.018", 11, "median"),
        ("-10.5", 4, ""),
        ("peak 12k more", 7, "peak"),
        ("peak 12k more", 9, "peak 12k"),
        ("所有世界", 5, "所有"),
        ("所有 12", 6, "所有"),
    ],
)
def test_fitted_text_has_no_part_of_a_number(text: str, width: int, fitted: str) -> None:
    assert fit_text(text, width) == fitted
    assert cell_len(fit_text(text, width, "…")) <= width
