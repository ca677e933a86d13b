"""Walls on maps without colours and in ASCII, cell by cell."""

from __future__ import annotations

import numpy as np
import pytest

from s2rtui.canvas import DIGITS, ColourMode, RenderOptions
from s2rtui.charts.map.terminal import draw_map, map_layout
from s2rtui.charts.shared.base_map_background import (
    FLOOR_RAMPS,
    WALL_LINES,
    wall_lines,
)
from s2rtui.charts.shared.heat_colours import heat_glyphs
from tests.charts.examples import BOUNDS, map_input

SIZE = (84, 30)
MODES = [
    RenderOptions(mode=ColourMode.NONE),
    RenderOptions(ascii=True),
    RenderOptions(mode=ColourMode.NONE, ascii=True),
]


def plan() -> np.ndarray:
    """20 x 10 m of light floor with walls of 20 cm at x = 10.1 m and, right of it, at y = 5.2 m."""
    image = np.full((500, 1000, 3), 225, dtype=np.uint8)
    image[:, 501:511] = 20
    image[257:267, 511:] = 20
    return image


@pytest.mark.parametrize("options", MODES)
@pytest.mark.parametrize("with_heat", [False, True])
def test_walls_have_characters_of_their_own(options: RenderOptions, with_heat: bool) -> None:
    heat = np.tile(np.linspace(0.0, 2.0, 100), (50, 1)) if with_heat else None
    nobody = np.zeros(60, dtype=np.bool_)
    view = map_input(
        floor_plan=plan(), heat=heat, rooms=(), cursor=None, selected=nobody, valid=nobody,
        bounds=BOUNDS,
    )  # fmt: skip
    canvas, layout = draw_map(view, SIZE, options), map_layout(view, SIZE, None, options)

    def drawn(points: list[tuple[float, float]]) -> set[str]:
        cells = np.floor(layout.frame.to_cells(points)).astype(int)
        return {str(canvas.char[row, column + layout.x]) for column, row in cells}

    heights = np.arange(0.5, 9.6, 0.25)
    upright = drawn([(10.12, y) for y in heights])
    level = drawn([(x, 5.24) for x in np.arange(11.0, 19.0, 0.25)])
    floor = drawn([(x, y) for x in (3.0, 7.0, 14.0, 17.0) for y in (1.5, 3.0, 7.5, 9.0)])
    lines = set(WALL_LINES[options.ascii])
    others = (
        FLOOR_RAMPS[options.ascii]
        + heat_glyphs(options, False)
        + heat_glyphs(options, True)
        + DIGITS
    )
    assert upright <= lines
    assert level <= lines
    assert upright & level <= {"╠"}, "lines show in which direction a wall runs"
    assert not floor & lines
    assert not lines & set(others)


def test_lines_join_neighbouring_walls() -> None:
    walls = np.array([[1, 1, 1, 0], [1, 0, 1, 1], [1, 1, 1, 0], [0, 0, 0, 1]], dtype=np.bool_)
    lines, held = wall_lines(walls, ascii=False)
    drawn = ["".join(row) for row in np.where(held, lines, " ").tolist()]
    assert drawn == ["╔═╗ ", "║ ╠═", "╚═╝ ", "   ╬"]
    plain, _ = wall_lines(walls, ascii=True)
    assert ["".join(row) for row in np.where(held, plain, " ").tolist()] == [
        "|_| ", "| |_", "|_| ", "   _",
    ]  # fmt: skip
