"""Cells of several or of trained instances say so, and the cursor lies on top of them."""

import numpy as np
import pytest

from s2rtui.canvas import Canvas, ColourMode, RenderOptions
from s2rtui.charts.compare import compare_drawing
from s2rtui.charts.map import map_drawing
from tests.charts.examples import (
    N,
    compare_input,
    draw_compare,
    draw_map,
    map_input,
    map_place,
    points_of,
)

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


def map_cells(
    options: RenderOptions, mode: str, trained: np.ndarray | None, **changes: object
) -> tuple[Canvas, list[tuple[int, int]]]:
    """A map, and the rows and columns of the lone instance and of the twins."""
    usual = map_input()
    view = map_input(
        **{name: twins(points_of(usual, name)) for name in ("truth", "sim", "real")},
        selected=SELECTED, plan=None, heat=None, rooms=(), headings=None,
        mode=mode, trained=trained, **({"cursor": None} | changes),
    )  # fmt: skip
    place = map_place(map_drawing(view), SIZE, options)
    return draw_map(view, SIZE, options), place.cells(points_of(view)[[ONE, TWINS[0]]])


@pytest.mark.parametrize(
    ("options", "mode", "trained", "glyphs", "bold", "legend"),
    [
        (COLOURS, "colour", None, "●■", None, "several"),
        (COLOURS, "full", None, "•●", None, "several"),
        (PLAIN, "colour", None, None, [False, True], "bold: several"),
        (ASCII, "colour", None, None, [False, True], "bold: several"),
        (PLAIN, "full", None, None, [False, True], "bold: several"),
        (COLOURS, "colour", TRAINED, "○▣", None, "○ ▣ trained on"),
        (COLOURS, "full", TRAINED, "○▣", None, "○ ▣ trained on"),
        (COLOURS, "glyph", TRAINED, "○②", None, "○ ②-⑨ ⊕ trained on"),
        (PLAIN, "full", TRAINED, "○○", None, "○ trained on"),
        (PLAIN, "glyph", TRAINED, "○②", None, "○ ②-⑨ ⊕ trained on"),
        (ASCII, "glyph", TRAINED, "tc", None, "t c-j T (for 1, 2-9, +) trained on"),
    ],
)
def test_the_map_shows_number_and_mark(options, mode, trained, glyphs, bold, legend):
    canvas, cells = map_cells(options, mode, trained)
    assert glyphs in (None, "".join(canvas.char[cell] for cell in cells))
    assert bold in (None, [bool(canvas.bold[cell]) for cell in cells])
    assert legend in text(canvas)


@pytest.mark.parametrize(
    ("options", "forms", "legend"),
    [(PLAIN, "⓪①②③④⑤⑥⑦⑧⑨", "⓪-⑨ trained on"), (ASCII, "abcdefghij", "a-j (for 0-9) trained on")],
)
def test_digits_of_values_keep_their_value(options, forms, legend):
    before, canvas = (map_cells(options, "colour", trained)[0] for trained in (None, TRAINED))
    _, cells = map_cells(options, "colour", TRAINED)
    digits = [before.char[cell] for cell in cells]
    assert "".join(digits).isdecimal()
    assert [canvas.char[cell] for cell in cells] == [forms[int(digit)] for digit in digits]
    assert legend in text(canvas)


@pytest.mark.parametrize(
    ("options", "several", "glyphs", "legend"),
    [
        (COLOURS, "▾▲", "▿△", "▽○△ trained on"),
        (PLAIN, "-+", "⊖⊕", "⊖⊜⊕ trained on"),
        (ASCII, "-+", "ba", "bea (for -=+) trained on"),
    ],
)
def test_the_comparison_shows_direction_number_and_mark(options, several, glyphs, legend):
    apart = np.where(np.arange(N) < 30, 1.0, -1.0)
    for trained, expected in ((None, several), (TRAINED, glyphs)):
        view = compare_input(
            truth=twins(points_of(compare_input())), first=2 + apart, second=np.full(N, 2.0),
            selected=SELECTED, plan=None, rooms=(), cursor=None, trained=trained,
        )  # fmt: skip
        canvas = draw_compare(view, SIZE, options)
        place = map_place(compare_drawing(view), SIZE, options)
        cells = place.cells(points_of(view)[[ONE, TWINS[0]]])
        assert "".join(canvas.char[cell] for cell in cells) == expected
        assert [bool(canvas.bold[cell]) for cell in cells] == [False, True]
        assert ("several" if trained is None else legend) in text(canvas)
