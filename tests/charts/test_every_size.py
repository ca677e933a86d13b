"""Every view draws at any size in any mode, in ASCII where requested, and no part of a number."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from s2rtui.canvas import LIGHT, Canvas, ColourMode, RenderOptions
from s2rtui.drawing.cells import draw_cells
from s2rtui.terminal.strips import to_strips
from tests.charts.examples import DRAWINGS

OPTIONS = [
    RenderOptions(),
    RenderOptions(theme=LIGHT, mode=ColourMode.PALETTE),
    RenderOptions(mode=ColourMode.ANSI),
    RenderOptions(mode=ColourMode.NONE),
    RenderOptions(mode=ColourMode.PALETTE, ascii=True),
    RenderOptions(mode=ColourMode.NONE, ascii=True),
]


@pytest.mark.parametrize("name", DRAWINGS)
@given(width=st.integers(1, 30), height=st.integers(1, 10), options=st.sampled_from(OPTIONS))
def test_small_sizes_are_filled_completely(name, width, height, options):
    canvas = draw_cells(DRAWINGS[name], (width, height), options)
    assert canvas.char.shape == (height, width)
    strips = to_strips(canvas, options.mode, options.ascii)
    assert [strip.cell_length for strip in strips] == [width] * height


@pytest.mark.parametrize("size", [(80, 24), (200, 60)])
def test_ascii_mode_uses_only_ascii_at_every_size(size):
    for name, drawing in DRAWINGS.items():
        for mode in (ColourMode.PALETTE, ColourMode.NONE):
            canvas = draw_cells(drawing, size, RenderOptions(mode=mode, ascii=True))
            assert "".join(canvas.lines()).isascii(), name


Written = list[tuple[Canvas, int, int, str]]


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> Written:
    """All texts with their canvas and the cell where they begin."""
    texts: Written = []
    write = Canvas.text

    def text(self, x, y, text, fg=None, bg=None, bold=False, align="left"):
        shift = {"left": 0, "right": cell_len(text), "center": cell_len(text) // 2}[align]
        texts.append((self, x - shift, y, text))
        return write(self, x, y, text, fg, bg, bold, align)

    monkeypatch.setattr(Canvas, "text", text)
    return texts


@pytest.mark.parametrize("name", DRAWINGS)
def test_no_view_shows_a_part_of_a_number(name, written):
    for size in ((16, 6), (24, 10), (50, 14), (80, 23)):
        draw_cells(DRAWINGS[name], size, RenderOptions())
        for canvas, x, y, text in written:
            for number in re.finditer(r"[-+]?\d[\d.]*", text):
                columns = range(x + number.start(), x + number.end())
                if not 0 <= y < canvas.height or not text.isascii():
                    continue
                shown = [
                    0 <= column < canvas.width and canvas.char[y, column] == glyph
                    for column, glyph in zip(columns, number[0], strict=True)
                ]
                assert all(shown) or not any(shown), (size, text, canvas.lines()[y])
        written.clear()
