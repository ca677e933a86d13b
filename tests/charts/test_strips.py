"""Strips contain the text of the canvas in few bytes, and the rasterizer draws their pixels."""

import re

import numpy as np
import pytest
from rich.console import Console
from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip

from s2rtui.canvas import DARK, Canvas, ColourMode
from s2rtui.canvas.glyph_masks import glyph_mask
from s2rtui.canvas.raster import draw_blocks, half_blocks
from s2rtui.export.screenshot import rasterize
from s2rtui.terminal.strips import merge_similar_colours, to_strips


def codes(strip: Strip) -> str:
    return strip.render(Console())


def noise(width: int = 30, height: int = 5) -> Canvas:
    random = np.random.default_rng(3)
    canvas = Canvas(width, height)
    canvas.char[:] = random.choice(list("▀ ab●"), canvas.char.shape)
    canvas.fg[:] = random.integers(0, 256, canvas.fg.shape)
    canvas.bg[:] = random.integers(0, 256, canvas.bg.shape)
    canvas.bold[:] = random.random(canvas.char.shape) < 0.3
    return canvas


def test_strips_have_exactly_the_codes_that_the_mode_needs():
    output = "".join(codes(strip) for strip in to_strips(noise(), ColourMode.NONE))
    assert not re.search(r"\x1b\[[\d;]*[34]8;", output)
    assert not re.search(r"[34][0-7]m", output)
    canvas = Canvas(2, 1)
    red, green, blue = DARK.background
    assert f"48;2;{red};{green};{blue}" in codes(to_strips(canvas, ColourMode.TRUECOLOR)[0])
    assert "48" not in codes(to_strips(canvas, ColourMode.ANSI)[0])


def test_equal_cells_share_a_segment_and_half_blocks_of_one_colour_become_spaces():
    canvas = Canvas(20, 1)
    canvas.text(0, 0, "one two three", DARK.sim)
    (strip,) = to_strips(canvas, ColourMode.TRUECOLOR)
    assert len(strip._segments) == 1
    canvas = Canvas(3, 1)
    canvas.char[:] = "▀"
    canvas.fg[:] = canvas.bg[:] = 99
    assert to_strips(canvas, ColourMode.TRUECOLOR)[0].text == "   "
    assert canvas.lines() == ["▀▀▀"]


@pytest.mark.parametrize("mode", [ColourMode.TRUECOLOR, ColourMode.PALETTE, ColourMode.ANSI])
@pytest.mark.parametrize("cut", [(0, 30), (0, 7), (4, 19), (29, 30)])
def test_delta_codes_give_the_same_cells_as_full_codes(mode, cut):
    """A terminal shows the same cells for both."""
    pyte = pytest.importorskip("pyte")
    canvas = noise()
    console = Console(color_system="256" if mode is ColourMode.PALETTE else "truecolor")
    screens = []
    for plain in (False, True):
        screen = pyte.Screen(canvas.width, canvas.height)
        stream = pyte.Stream(screen)
        for row, strip in enumerate(to_strips(canvas, mode)):
            cropped = (Strip(strip._segments) if plain else strip).crop(*cut)
            assert cropped.cell_length == cut[1] - cut[0]
            stream.feed(f"\x1b[{row + 1};1H{cropped.render(console)}")
        cells = [screen.buffer[row][x] for row, x in np.ndindex(canvas.height, canvas.width)]
        inked = [(cell.bold, cell.fg) if cell.data != " " else () for cell in cells]
        screens.append([(cell.data, cell.bg, *ink) for cell, ink in zip(cells, inked, strict=True)])
    assert screens[0] == screens[1]


def test_cropping_a_wide_character_leaves_a_space():
    canvas = Canvas(6, 1)
    canvas.text(0, 0, "a界b界", DARK.sim)
    (strip,) = to_strips(canvas, ColourMode.TRUECOLOR)
    for start in range(6):
        for end in range(start + 1, 7):
            plain = Strip(strip._segments).crop(start, end)
            assert strip.crop(start, end).text == plain.text
            assert strip.crop(start, end).cell_length == end - start


def test_delta_codes_are_shorter():
    canvas = noise(100, 10)
    strips = to_strips(canvas, ColourMode.PALETTE)
    console = Console(color_system="256")
    plain = sum(len(Strip(strip._segments).render(console)) for strip in strips)
    assert sum(len(codes(strip)) for strip in strips) < 0.8 * plain


def test_only_similar_image_colours_are_merged():
    canvas = Canvas(4, 1)
    canvas.char[0] = list("▀▀▀a")
    canvas.fg[0, :, 0] = (100, 106, 150, 151)
    canvas.fg[0, :, 1:] = 0
    canvas.bg[:] = 7
    merge_similar_colours(canvas, 10)
    assert canvas.fg[0, :, 0].tolist() == [100, 100, 150, 151]


def test_merging_keeps_the_edge_between_image_and_background():
    canvas = Canvas(12, 1)
    red, green, blue = canvas.theme.background
    pixels = np.zeros((2, 12, 3), dtype=np.uint8)
    pixels[:, :6] = canvas.theme.background
    pixels[:, 6:] = (red + 6, green + 6, blue + 6)
    draw_blocks(canvas, half_blocks(pixels))
    merge_similar_colours(canvas, 12)
    assert (canvas.bg[0, :6] == canvas.theme.background).all()
    assert (canvas.bg[0, 6:] == pixels[0, 6:]).all()


RED = Style(color="#ff0000", bgcolor="#0000ff")


def pixels(text: str, style: Style = RED) -> np.ndarray:
    return np.asarray(rasterize([[Segment(text, style)]]))


def test_a_cell_is_10_by_20_pixels_and_a_half_block_fills_half_of_it():
    assert pixels("ab").shape == pixels("界").shape == (20, 20, 3)
    cell = pixels("▀")
    assert (cell[:10] == (255, 0, 0)).all()
    assert (cell[10:] == (0, 0, 255)).all()


def test_box_lines_are_continuous_across_cells():
    rows = [[Segment("┌─┐", RED)], [Segment("│ │", RED)], [Segment("└─┘", RED)]]
    ink = np.asarray(rasterize(rows))[..., 0] == 255
    middle = np.flatnonzero(ink[:, 15])
    assert ink[middle[0], 5:25].all()
    left = np.flatnonzero(ink[30])[0]
    assert ink[10:50, left].all()


def test_every_geometric_character_has_ink_within_its_cell():
    for code in (*range(0x2500, 0x25A0), *range(0x2801, 0x2900)):
        mask = glyph_mask(chr(code), 20, 10)
        assert mask is not None, hex(code)
        assert mask.shape == (20, 10)
        assert 0 < mask.sum() <= 200, hex(code)
        assert mask.min() >= 0
        assert mask.max() <= 1


def test_bold_letters_have_more_ink():
    plain = (pixels("m") != (0, 0, 255)).any(axis=-1).sum()
    bold = (pixels("m", RED + Style(bold=True)) != (0, 0, 255)).any(axis=-1).sum()
    assert 20 < plain < bold < 200


def test_missing_colours_are_those_of_the_theme():
    cell = np.asarray(rasterize([[Segment(" ", None)]]))
    assert (cell == DARK.background).all()
    reversed_cell = np.asarray(rasterize([[Segment(" ", Style(reverse=True))]]))
    assert (reversed_cell == DARK.text).all()
