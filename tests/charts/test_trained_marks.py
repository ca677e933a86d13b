"""Cells with trained instances say so, and keep their number of instances or their value."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from s2rtui.canvas import Canvas, ColourMode, RenderOptions
from s2rtui.charts.compare.terminal import compare_layout, draw_compare
from s2rtui.charts.map.terminal import draw_map, map_layout
from s2rtui.charts.scatter.model import ScatterInput
from s2rtui.charts.scatter.terminal import draw_scatter, scatter_panels
from s2rtui.charts.umap.terminal import draw_umap, umap_panels
from tests.charts.examples import N, compare_input, map_input, umap_input

SIZE = (120, 40)
PLAIN, ASCII = RenderOptions(mode=ColourMode.NONE), RenderOptions(ascii=True)
COLOURS = RenderOptions()
ONE, TWINS = 20, (44, 45)
"""An instance alone in its cell, and two in one cell; the model was trained on the second one."""
SELECTED = np.isin(np.arange(N), [ONE, *TWINS])
TRAINED = np.isin(np.arange(N), [ONE, TWINS[1]])


def twins(points: np.ndarray) -> np.ndarray:
    """The points with those of both twins at one place."""
    moved = points.copy()
    moved[TWINS[1]] = moved[TWINS[0]]
    return moved


def text(canvas: Canvas) -> str:
    return "\n".join(canvas.lines())


def map_glyphs(options: RenderOptions, mode: str, trained: np.ndarray | None) -> tuple[str, str]:
    """The glyphs of the lone instance and of the twins, and the whole text of the map."""
    view = map_input(
        selected=SELECTED, floor_plan=None, heat=None, rooms=(), cursor=None, headings=None,
        mode=mode, trained=trained,
    )  # fmt: skip
    view = replace(view, **{name: twins(getattr(view, name)) for name in ("truth", "sim", "real")})
    layout = map_layout(view, SIZE, None, options)
    cells = np.floor(layout.frame.to_cells(view.truth[[ONE, TWINS[0]]])).astype(int)
    canvas = draw_map(view, SIZE, options)
    return "".join(canvas.char[row, x + layout.x] for x, row in cells.tolist()), text(canvas)


@pytest.mark.parametrize(
    ("options", "mode", "glyphs", "legend"),
    [
        (COLOURS, "colour", "○▣", "○ ▣ trained on"),
        (COLOURS, "full", "○▣", "○ ▣ trained on"),
        (COLOURS, "glyph", "○②", "○ ②-⑨ ⊕ trained on"),
        (PLAIN, "full", "○○", "○ trained on"),
        (PLAIN, "glyph", "○②", "○ ②-⑨ ⊕ trained on"),
        (ASCII, "glyph", "tc", "t c-j T (for 1, 2-9, +) trained on"),
    ],
)
def test_the_map_shows_number_and_mark(
    options: RenderOptions, mode: str, glyphs: str, legend: str
) -> None:
    drawn, shown = map_glyphs(options, mode, TRAINED)
    assert drawn == glyphs
    assert legend in shown


@pytest.mark.parametrize(
    ("options", "forms", "legend"),
    [
        (PLAIN, "⓪①②③④⑤⑥⑦⑧⑨", "⓪-⑨ trained on"),
        (ASCII, "abcdefghij", "a-j (for 0-9) trained on"),
    ],
)
def test_digits_of_values_keep_their_value(options: RenderOptions, forms: str, legend: str) -> None:
    before, _ = map_glyphs(options, "colour", None)
    drawn, shown = map_glyphs(options, "colour", TRAINED)
    assert before.isdecimal()
    assert drawn == "".join(forms[int(digit)] for digit in before)
    assert legend in shown


@pytest.mark.parametrize(
    ("options", "legend"), [(COLOURS, "○ ②-⑨ ⊕ trained on"), (ASCII, "a-j (for 0-9) trained on")]
)
def test_the_umap_shows_number_and_mark(options: RenderOptions, legend: str) -> None:
    sim = twins(umap_input().sim)
    views = [
        umap_input(sim=sim, selected=SELECTED, cursor=None, trained=trained)
        for trained in (None, TRAINED)
    ]
    before, canvas = (draw_umap(view, SIZE, options) for view in views)
    panel = umap_panels(views[1], SIZE, options)[0]
    cells = [
        (int(row), int(column))
        for column, row in (panel.to_cells(*sim[iid]) for iid in (ONE, TWINS[0]))
    ]
    expected = "○②"
    if options.ascii:
        expected = "".join("abcdefghij"[int(before.char[cell])] for cell in cells)
    assert "".join(canvas.char[cell] for cell in cells) == expected
    assert legend in text(canvas)


@pytest.mark.parametrize(
    ("options", "glyphs", "legend"),
    [
        (COLOURS, "▿△", "▽○△ trained on"),
        (PLAIN, "⊖⊕", "⊖⊜⊕ trained on"),
        (ASCII, "ba", "bea (for -=+) trained on"),
    ],
)
def test_the_comparison_shows_direction_number_and_mark(
    options: RenderOptions, glyphs: str, legend: str
) -> None:
    apart = np.where(np.arange(N) < 30, 1.0, -1.0)
    view = compare_input(
        truth=twins(compare_input().truth), first=2 + apart, second=np.full(N, 2.0),
        selected=SELECTED, floor_plan=None, rooms=(), cursor=None, trained=TRAINED,
    )  # fmt: skip
    canvas, layout = draw_compare(view, SIZE, options), compare_layout(view, SIZE, None, options)
    places = np.floor(layout.frame.to_cells(view.truth[[ONE, TWINS[0]]])).astype(int).tolist()
    cells = [(row, column + layout.x) for column, row in places]
    assert "".join(canvas.char[cell] for cell in cells) == glyphs
    assert [bool(canvas.bold[cell]) for cell in cells] == [False, True]
    assert legend in text(canvas)


@pytest.mark.parametrize(
    ("options", "glyphs", "legend"),
    [
        (COLOURS, "○③⊕", "○ ②-⑨ ⊕ trained on"),
        (PLAIN, "○③⊕", "○ ②-⑨ ⊕ trained on"),
        (ASCII, "tdT", "t c-j T (for 1, 2-9, +) trained on"),
    ],
)
def test_the_scatter_shows_number_and_mark(
    options: RenderOptions, glyphs: str, legend: str
) -> None:
    sim = np.array([8.0] + [1.0] * 3 + [4.0] * 12)
    real = np.array([1.0] + [8.0] * 3 + [2.0] * 12)
    everything, trained = np.ones(16, dtype=np.bool_), np.isin(np.arange(16), [0, 1, 4])
    data = ScatterInput(sim, real, everything, everything, trained=trained)
    canvas, panel = draw_scatter(data, (80, 30), options), scatter_panels(data, (80, 30))[0]
    cells = [panel.to_cells(sim[iid], real[iid]) for iid in (0, 1, 4)]
    assert "".join(canvas.char[int(row), int(column)] for column, row in cells) == glyphs
    assert legend in text(canvas)
