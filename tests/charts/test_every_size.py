"""Every view draws at any size in any mode, and ASCII mode uses only ASCII characters."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rtui.canvas import LIGHT, ColourMode, RenderOptions
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
