"""The rasterizer converts cells to pixels deterministically."""

from __future__ import annotations

from io import BytesIO

import numpy as np
from PIL import Image
from rich.segment import Segment
from rich.style import Style

from s2rtui.canvas import DARK, Canvas, ColourMode
from s2rtui.canvas.glyph_masks import glyph_mask
from s2rtui.export.rasterizer import rasterize, rasterize_png
from s2rtui.terminal.strips import to_strips

RED = Style(color="#ff0000", bgcolor="#0000ff")


def pixels(text: str, style: Style = RED) -> np.ndarray:
    return np.asarray(rasterize([[Segment(text, style)]]))


def test_a_cell_is_10_by_20_pixels() -> None:
    assert pixels("ab").shape == (20, 20, 3)


def test_a_half_block_fills_half_of_the_cell() -> None:
    cell = pixels("▀")
    assert (cell[:10] == (255, 0, 0)).all()
    assert (cell[10:] == (0, 0, 255)).all()


def test_box_lines_are_continuous_across_cells() -> None:
    rows = [[Segment("┌─┐", RED)], [Segment("│ │", RED)], [Segment("└─┘", RED)]]
    ink = np.asarray(rasterize(rows))[..., 0] == 255
    middle = np.flatnonzero(ink[:, 15])
    assert ink[middle[0], 5:25].all()
    left = np.flatnonzero(ink[30])[0]
    assert ink[10:50, left].all()


def test_every_geometric_character_has_ink_within_its_cell() -> None:
    for code in (*range(0x2500, 0x25A0), *range(0x2801, 0x2900)):
        mask = glyph_mask(chr(code), 20, 10)
        assert mask is not None, hex(code)
        assert mask.shape == (20, 10)
        assert 0 < mask.sum() <= 200, hex(code)
        assert mask.min() >= 0
        assert mask.max() <= 1


def test_mirrored_blocks_have_mirrored_pixels() -> None:
    def mask(char: str) -> np.ndarray:
        pixels_of_glyph = glyph_mask(char, 20, 10)
        assert pixels_of_glyph is not None
        return pixels_of_glyph

    assert (mask("▌")[:, ::-1] == mask("▐")).all()
    assert (mask("▀")[::-1] == mask("▄")).all()
    assert (mask("▛")[::-1, ::-1] == mask("▟")).all()
    assert mask("█").all()


def test_bold_letters_have_more_ink() -> None:
    plain = (pixels("m") != (0, 0, 255)).any(axis=-1).sum()
    bold = (pixels("m", RED + Style(bold=True)) != (0, 0, 255)).any(axis=-1).sum()
    assert 20 < plain < bold < 200


def test_wide_characters_fill_two_cells() -> None:
    assert pixels("界").shape == (20, 20, 3)


def test_missing_colours_are_those_of_the_theme() -> None:
    cell = np.asarray(rasterize([[Segment(" ", None)]]))
    assert (cell == DARK.background).all()
    reversed_cell = np.asarray(rasterize([[Segment(" ", Style(reverse=True))]]))
    assert (reversed_cell == DARK.text).all()


def test_rasterized_images_are_deterministic() -> None:
    canvas = Canvas(30, 4)
    canvas.text(2, 1, "sim ◆ real ◇", DARK.sim, bold=True)
    first, second = (rasterize_png(to_strips(canvas, ColourMode.TRUECOLOR)) for _ in range(2))
    assert first == second
    assert Image.open(BytesIO(first)).size == (300, 80)
