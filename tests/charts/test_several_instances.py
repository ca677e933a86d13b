"""Cells with several instances show that they hold several, and the cursor lies on top of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from s2rtui.canvas import Canvas, ColourMode, RenderOptions
from s2rtui.charts.compare.terminal import compare_layout, draw_compare
from s2rtui.charts.map.terminal import draw_map, map_layout
from s2rtui.charts.umap.terminal import draw_umap, umap_panels
from tests.charts.examples import N, compare_input, map_input, umap_input

SIZE = (120, 40)
ONE, TWINS = 20, (44, 45)
"""An instance alone in its cell, and two in one cell."""
NO_COLOURS = (RenderOptions(mode=ColourMode.NONE), RenderOptions(ascii=True))
SELECTED = np.isin(np.arange(N), [ONE, *TWINS])


def twins(points: np.ndarray) -> np.ndarray:
    """The points with those of both twins at one place."""
    moved = points.copy()
    moved[TWINS[1]] = moved[TWINS[0]]
    return moved


def map_cells(options: RenderOptions, **changes: object) -> tuple[Canvas, list[tuple[int, int]]]:
    """A map, and the rows and columns of the lone instance and of the twins."""
    plain = map_input(
        selected=SELECTED, floor_plan=None, heat=None, rooms=(), cursor=None, **changes
    )
    points = {name: twins(getattr(plain, name)) for name in ("truth", "sim", "real")}
    view = replace(plain, **points)
    layout = map_layout(view, SIZE, None, options)
    cells = np.floor(layout.frame.to_cells(view.truth[[ONE, TWINS[0]]])).astype(int)
    return draw_map(view, SIZE, options), [(row, x + layout.x) for x, row in cells.tolist()]


@pytest.mark.parametrize(("mode", "glyphs"), [("colour", "●■"), ("full", "•●")])
def test_several_instances_of_the_map_have_another_glyph(mode: str, glyphs: str) -> None:
    canvas, cells = map_cells(RenderOptions(), mode=mode)
    assert "".join(canvas.char[cell] for cell in cells) == glyphs
    assert "several" in "\n".join(canvas.lines()[-2:])


@pytest.mark.parametrize("options", NO_COLOURS)
@pytest.mark.parametrize("mode", ["colour", "full"])
def test_without_colours_several_instances_of_the_map_are_bold(
    mode: str, options: RenderOptions
) -> None:
    canvas, cells = map_cells(options, mode=mode)
    assert [bool(canvas.bold[cell]) for cell in cells] == [False, True]
    assert "bold: several" in "\n".join(canvas.lines()[-2:])


def test_the_cursor_is_on_top_of_several_instances() -> None:
    canvas, cells = map_cells(RenderOptions())
    view = map_input(
        truth=twins(map_input().truth), selected=SELECTED, cursor=TWINS[0], headings=None,
        floor_plan=None, heat=None, rooms=(),
    )  # fmt: skip
    assert canvas.char[cells[1]] == "■"
    assert draw_map(view, SIZE).char[cells[1]] == "◉"


@pytest.mark.parametrize("options", [RenderOptions(), *NO_COLOURS])
def test_several_instances_of_the_umap_differ_from_one(options: RenderOptions) -> None:
    sim = twins(umap_input().sim)
    view = umap_input(sim=sim, selected=SELECTED, cursor=None)
    canvas = draw_umap(view, SIZE, options)
    panel = umap_panels(view, SIZE, options)[0]
    places = [panel.to_cells(*sim[iid]) for iid in (ONE, TWINS[0])]
    cells = [(int(row), int(column)) for column, row in places]
    if options == RenderOptions():
        assert [(ord(canvas.char[cell]) - 0x2800).bit_count() for cell in cells] == [1, 2]
    else:
        assert [bool(canvas.bold[cell]) for cell in cells] == [False, True]
        assert "several" in "\n".join(canvas.lines())


@pytest.mark.parametrize("options", [RenderOptions(), *NO_COLOURS])
def test_several_instances_of_the_comparison_are_larger_or_bold(options: RenderOptions) -> None:
    apart = np.where(np.arange(N) < 30, 1.0, -1.0)
    view = compare_input(
        truth=twins(compare_input().truth), first=2 + apart, second=np.full(N, 2.0),
        selected=SELECTED, floor_plan=None, rooms=(), cursor=None,
    )  # fmt: skip
    canvas, layout = draw_compare(view, SIZE, options), compare_layout(view, SIZE, None, options)
    places = np.floor(layout.frame.to_cells(view.truth[[ONE, TWINS[0]]])).astype(int).tolist()
    cells = [(row, column + layout.x) for column, row in places]
    if options == RenderOptions():
        assert [canvas.char[cell] for cell in cells] == ["▾", "▲"]
    assert [bool(canvas.bold[cell]) for cell in cells] == [False, True]
    assert "several" in "\n".join(canvas.lines()[-2:])
