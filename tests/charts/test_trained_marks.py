"""Cells of several or of trained instances say so, and the cursor lies on top of them."""

from dataclasses import replace

import numpy as np
import pytest

from s2rtui.canvas import Canvas, ColourMode, RenderOptions
from s2rtui.charts.compare.terminal import compare_layout, draw_compare
from s2rtui.charts.map.terminal import draw_map, map_layout
from tests.charts.examples import N, compare_input, map_input

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
    view = map_input(
        selected=SELECTED, floor_plan=None, heat=None, rooms=(), headings=None,
        mode=mode, trained=trained, **({"cursor": None} | changes),
    )  # fmt: skip
    view = replace(view, **{name: twins(getattr(view, name)) for name in ("truth", "sim", "real")})
    layout = map_layout(view, SIZE, None, options)
    cells = np.floor(layout.frame.to_cells(view.truth[[ONE, TWINS[0]]])).astype(int)
    return draw_map(view, SIZE, options), [(row, x + layout.x) for x, row in cells.tolist()]


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


def test_the_cursor_is_on_top_of_several_instances():
    canvas, cells = map_cells(COLOURS, "colour", None, cursor=TWINS[0])
    assert canvas.char[cells[1]] == "◉"


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
            truth=twins(compare_input().truth), first=2 + apart, second=np.full(N, 2.0),
            selected=SELECTED, floor_plan=None, rooms=(), cursor=None, trained=trained,
        )  # fmt: skip
        canvas, layout = (
            draw_compare(view, SIZE, options),
            compare_layout(view, SIZE, None, options),
        )
        places = np.floor(layout.frame.to_cells(view.truth[[ONE, TWINS[0]]])).astype(int).tolist()
        cells = [(row, column + layout.x) for column, row in places]
        assert "".join(canvas.char[cell] for cell in cells) == expected
        assert [bool(canvas.bold[cell]) for cell in cells] == [False, True]
        assert ("several" if trained is None else legend) in text(canvas)
