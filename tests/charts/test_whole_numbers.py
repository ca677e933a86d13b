"""No view shows a part of a number, and every colour bar has the numbers of its two ends."""

import re

import numpy as np
import pytest
from rich.cells import cell_len

from s2rtui.canvas import Canvas, ColourMode, RenderOptions
from s2rtui.charts.map import map_drawing
from s2rtui.charts.shared.instance import depth_scale, heat_scale, instance_drawing
from s2rtui.drawing.cells import draw_cells
from s2rtui.drawing.drawing import ColourBar
from s2rtui.drawing.drawing_layout import drawing_layout
from s2rtui.drawing.scale import Interval, short_number
from tests.charts.examples import (
    DRAWINGS,
    compare_input,
    draw_compare,
    draw_map,
    instance_input,
    map_input,
    umap_drawing,
)

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


SIZES = ((80, 20), (66, 33), (52, 14), (48, 20), (120, 36), (66, 50), (200, 56))
"""Columns and rows of views on screens of 80x24, 120x40 and 200x60."""
OPTIONS = (RenderOptions(), RenderOptions(mode=ColourMode.NONE), RenderOptions(ascii=True))


def ends(scale: Interval | None) -> tuple[str, str]:
    assert scale is not None
    low, high = (short_number(end, 2) for end in scale)
    return low, high


@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("size", SIZES)
def test_both_ends_are_labelled(size, options):
    on_map = map_input(values=np.linspace(0.31, 7.7, 60))
    (legend,) = map_drawing(on_map).notes
    values, heat = (ends(bar.scale) for bar in legend if isinstance(bar, ColourBar))
    compared, pair = compare_input(), instance_input()
    embedded, of_pair = umap_drawing(), draw_cells(instance_drawing(pair), size, options)
    drawn = (
        (draw_map(on_map, size, options), values),
        (draw_cells(embedded, size, options), ends(embedded.notes[0][0].scale)),
    )  # fmt: skip
    places = drawing_layout(instance_drawing(pair), size, options).plots
    if options.supports_images or any(place.plot.image.ground is None for place in places):
        drawn += ((of_pair, ends(heat_scale(pair))),)
    if any(place.plot.y.names == ("depth",) for place in places):
        drawn += ((of_pair, ends(depth_scale(pair))),)
    if size[1] >= 18:
        scale = compared.scale
        drawn += ((draw_compare(compared, size, options), ends((-scale, scale))),)
        drawn += ((draw_map(on_map, size, options), heat),)
    for canvas, (low, high) in drawn:
        rows = [line for line in canvas.lines() if low in line and high in line]
        assert any(line.index(low) < line.rindex(high) for line in rows), "\n".join(canvas.lines())
