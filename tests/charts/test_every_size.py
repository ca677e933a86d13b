"""Every view draws at any size in any mode, and ASCII mode uses only ASCII characters."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rtui.canvas import LIGHT, Canvas, ColourMode, RenderOptions
from s2rtui.canvas.marks import BrushShape
from s2rtui.charts.shared.instance import instance_drawing
from s2rtui.charts.suggestions import suggestions_drawing
from s2rtui.drawing.cells import draw_cells
from s2rtui.terminal.strips import to_strips
from tests.charts.examples import (
    compare_input,
    counts_drawing,
    draw_compare,
    draw_map,
    errors_drawing,
    findings_of,
    groups_drawing,
    history_drawing,
    instance_input,
    list_drawing,
    map_input,
    orientation_drawing,
    overview_drawing,
    overview_lines,
    scatter_of,
    side,
    umap_drawing,
)
from tests.drawing import examples
from tests.support import gaps
from tests.support.suggestions import suggestions_input

Draw = Callable[[tuple[int, int], RenderOptions], Canvas]
BOX = BrushShape("map", ((2.0, 2.0), (9.0, 5.0)))
LASSO = BrushShape("map", ((2.0, 2.0), (9.0, 5.0), (4.0, 8.0)), lasso=True)
RANGE = BrushShape("vanilla", ((0.6, 0.0), (0.8, 0.0)))


def drawing(draw: Callable[..., Canvas], *data: Any) -> Draw:
    return lambda size, options: draw(*data, size, options)


VIEWS: dict[str, Draw] = {
    "overview": drawing(draw_cells, overview_drawing()),
    "overview lines": drawing(draw_cells, overview_drawing(overview_lines(), brush=RANGE)),
    "map": drawing(draw_map, map_input()),
    "full map": drawing(draw_map, map_input(mode="full")),
    "glyph map": lambda size, options: draw_map(
        map_input(mode="glyph", seen=np.eye(5)), size, options, brush=BOX
    ),
    "bare map": drawing(draw_map, map_input(plan=None, heat=None, headings=None, cursor=None)),
    "compare": lambda size, options: draw_compare(compare_input(), size, options, LASSO),
    "instance": drawing(draw_cells, instance_drawing(instance_input())),
    "plain instance": drawing(
        draw_cells,
        instance_drawing(
            instance_input(sim=side(1, False, False), real=side(2, False, False), truth=None)
        ),
    ),
    "marked histogram": drawing(
        draw_cells, errors_drawing(5, brush=BrushShape("real", ((0.2, 3.0), (99.0, -1.0))))
    ),
    "history": drawing(draw_cells, history_drawing(gaps.week(), 60)),
    "marked umap": drawing(
        draw_cells,
        umap_drawing(brush=BrushShape("real", ((-9.0, -9.0), (3.0, 3.0), (4.0, 9.0)), lasso=True)),
    ),
    "marked orientation": drawing(
        draw_cells,
        orientation_drawing(
            cursor={"sim": 30.0}, brush=BrushShape("sim", ((170.0, 1.0), (-120.0, 9.0)))
        ),
    ),
    "marked scatter": drawing(
        draw_cells,
        scatter_of(
            cursor=5, brush=BrushShape("errors", ((0.5, 0.5), (9.0, 3.0), (1.0, -2.0)), lasso=True)
        ),
    ),
    "marked rooms": drawing(
        draw_cells, counts_drawing(BrushShape("truth", ((0.0, 1.0), (0.0, 9.0))))
    ),
    "marked groups": drawing(
        draw_cells, groups_drawing(brush=BrushShape("groups", ((0.0, 3.0), (0.0, 4.0))))
    ),
    "findings": drawing(draw_cells, findings_of(chosen=2)),
    "no findings": drawing(draw_cells, findings_of(0)),
    "suggestions": drawing(draw_cells, suggestions_drawing(suggestions_input())),
    "list": drawing(draw_cells, list_drawing(7)),
    "drawing": drawing(draw_cells, examples.drawing()),
    "no suggestions": drawing(draw_cells, suggestions_drawing(suggestions_input(real=0, sim=0))),
}
OPTIONS = [
    RenderOptions(),
    RenderOptions(theme=LIGHT, mode=ColourMode.PALETTE),
    RenderOptions(mode=ColourMode.ANSI),
    RenderOptions(mode=ColourMode.NONE),
    RenderOptions(mode=ColourMode.PALETTE, ascii=True),
    RenderOptions(mode=ColourMode.NONE, ascii=True),
]


@pytest.mark.parametrize("name", VIEWS)
@given(width=st.integers(1, 30), height=st.integers(1, 10), options=st.sampled_from(OPTIONS))
def test_small_sizes_are_filled_completely(name, width, height, options):
    canvas = VIEWS[name]((width, height), options)
    assert canvas.char.shape == (height, width)
    strips = to_strips(canvas, options.mode, options.ascii)
    assert [strip.cell_length for strip in strips] == [width] * height


@pytest.mark.parametrize("size", [(80, 24), (200, 60)])
def test_ascii_mode_uses_only_ascii_at_every_size(size):
    for name, draw in VIEWS.items():
        for mode in (ColourMode.PALETTE, ColourMode.NONE):
            canvas = draw(size, RenderOptions(mode=mode, ascii=True))
            assert "".join(canvas.lines()).isascii(), name
