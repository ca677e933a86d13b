"""Points of a plot: the mean level of a cell, counts, marks, and places on any scale."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.canvas import DARK, LIGHT, Canvas, ColourMode, RenderOptions
from s2rtui.canvas.colour import legible, turbo
from s2rtui.drawing.cells import draw_cells
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.plot import LEVELS, Plot, Points
from s2rtui.drawing.plot_cells import column_of, draw_marks, row_of
from s2rtui.drawing.points import Grid, point_cells
from s2rtui.drawing.points_cells import SHADE_STEPS
from s2rtui.drawing.scale import Scale

COUNT = 25
WIDTH, HEIGHT = 9, 5
coordinates = arrays.arrays(np.float64, COUNT, elements=st.floats(0.01, 10) | st.just(np.nan))
masks = arrays.arrays(np.bool_, COUNT)
levels = arrays.arrays(np.uint16, COUNT, elements=st.integers(0, LEVELS))
scales = st.sampled_from([Scale(0.0, 10.0), Scale(2.0, 7.0), Scale(0.1, 10.0, log=True)])
OPTIONS = RenderOptions()


def points(x: Any, y: Any, **changes: Any) -> Points:
    everyone = np.ones(len(x), dtype=np.bool_)
    fields: dict[str, Any] = {
        "levels": np.ones(len(x), dtype=np.uint16), "selected": everyone, "valid": everyone,
    }  # fmt: skip
    return Points(np.asarray(x, float), np.asarray(y, float), **(fields | changes))


def drawn(mark: Points, options: RenderOptions = OPTIONS, size: tuple[int, int] = (20, 10)
          ) -> tuple[Canvas, Any]:  # fmt: skip
    """The plot on 0 .. 10, and the cell of each point."""
    plot = Plot(Scale(0.0, 10.0), Scale(0.0, 10.0), (mark,))
    canvas = Canvas(*size, options)
    draw_marks(canvas, plot)
    return canvas, lambda iid: (row_of(plot.y, float(mark.y[iid]), size[1]),
                                column_of(plot.x, float(mark.x[iid]), size[0]))  # fmt: skip


@given(coordinates, coordinates, levels, masks, masks, scales, scales)
def test_cells_show_the_mean_level_of_selected_instances(x, y, level, selected, valid, across, up):
    mark = points(x, y, levels=level, selected=selected, valid=valid, trained=level > LEVELS // 2)
    cells = point_cells(mark, Grid(across, up, WIDTH, HEIGHT))
    places = np.stack([across.fraction(x) * WIDTH, HEIGHT - up.fraction(y) * HEIGHT], axis=1)
    members: dict[tuple[int, int], list[int]] = {}
    occupied = np.zeros((HEIGHT, WIDTH), dtype=np.bool_)
    total = 0
    for iid in np.flatnonzero(valid & np.isfinite(places).all(axis=1)).tolist():
        column, row = math.floor(places[iid, 0]), math.ceil(places[iid, 1]) - 1
        if 0 <= column < WIDTH and 0 <= row < HEIGHT:
            occupied[row, column] = True
            total += 1
            if selected[iid]:
                members.setdefault((row, column), []).append(iid)
    shown = np.zeros_like(occupied)
    for cell, iids in members.items():
        known = level[iids][level[iids] > 0]
        assert cells.level[cell] == (np.rint(known.mean()) if known.size else 0)
        assert cells.count[cell] == len(iids)
        assert cells.trained[cell] == (level[iids] > LEVELS // 2).any()
        shown[cell] = True
    np.testing.assert_array_equal(cells.level >= 0, shown)
    grey = cells.grey.reshape(HEIGHT, 4, WIDTH, 2).any(axis=(1, 3))
    np.testing.assert_array_equal(grey, occupied & ~shown)
    assert (cells.selected, cells.total) == (sum(map(len, members.values())), total)


@pytest.mark.parametrize("theme", [DARK, LIGHT])
def test_a_selected_point_has_the_colour_of_its_level_or_class(theme):
    options = RenderOptions(theme=theme)
    canvas, cell = drawn(points([5.0], [5.0], levels=np.array([17], np.uint16)), options)
    assert 0x2800 < ord(canvas.char[cell(0)]) <= 0x28FF
    expected = legible(turbo([16.5 / LEVELS]), theme)[0]
    np.testing.assert_array_equal(canvas.fg[cell(0)], expected)
    classes = points([2.0, 8.0], [5.0, 5.0], levels=np.array([1, 2], np.uint16),
                     inks=("sim", "real"))  # fmt: skip
    canvas, cell = drawn(classes, options)
    assert [tuple(canvas.fg[cell(iid)]) for iid in (0, 1)] == [theme.sim, theme.real]


@pytest.mark.parametrize(
    "options", [RenderOptions(mode=ColourMode.NONE), RenderOptions(ascii=True)]
)
def test_digits_and_signs_replace_colours(options):
    level = np.array([1, LEVELS, 0], np.uint16)
    canvas, cell = drawn(points([1, 5, 9], [5, 5, 5], levels=level), options)
    assert [canvas.char[cell(iid)] for iid in range(3)] == ["0", "9", "?"]
    mark = points([1, 5, 9, 9], [5, 5, 5, 5], levels=np.array([1, 2, 1, 1], np.uint16),
                  inks=("sim", "real"))  # fmt: skip
    canvas, cell = drawn(mark, options)
    glyphs = canvas.glyphs
    assert [canvas.char[cell(iid)] for iid in range(3)] == [glyphs.sim, glyphs.real, glyphs.sim]
    assert [bool(canvas.bold[cell(iid)]) for iid in range(3)] == [False, False, True]


@pytest.mark.parametrize("crowd", [1, 8, 9, 512, 513, 4096, 4097])
def test_a_cell_shows_how_many_points_it_has(crowd):
    places = 5.1 + np.random.default_rng(crowd).uniform(-0.002, 0.002, (2, crowd))
    mark = points(*places, selected=np.zeros(crowd, dtype=np.bool_))
    canvas, cell = drawn(mark)
    shade = canvas.glyphs.shades[sum(crowd >= least for least in SHADE_STEPS)]
    glyph = canvas.char[cell(0)]
    assert glyph == shade if shade.strip() else (ord(glyph) - 0x2800).bit_count() == crowd


@pytest.mark.parametrize(
    ("options", "classes", "glyphs", "legend"),
    [
        (OPTIONS, False, "○③⊕", "○ ②-⑨ ⊕ trained on"),
        (OPTIONS, True, "○③⊕", "○ ②-⑨ ⊕ trained on"),
        (RenderOptions(mode=ColourMode.NONE), False, "⑨⓪⓪", "⓪-⑨ trained on"),
        (RenderOptions(mode=ColourMode.NONE), True, "○○○", "trained on"),
        (RenderOptions(ascii=True), False, "jaa", "a-j (for 0-9) trained on"),
    ],
)
def test_cells_of_trained_instances_keep_their_number_or_value(options, classes, glyphs, legend):
    x = np.array([8.0] + [1.0] * 3 + [4.0] * 12)
    y = np.array([1.0] + [8.0] * 3 + [2.0] * 12)
    level = np.array([2 if classes else LEVELS] + [1] * 15, np.uint16)
    inks = ("sim", "real") if classes else ()
    mark = points(x, y, levels=level, trained=np.isin(np.arange(16), [0, 1, 4]), inks=inks)
    canvas, cell = drawn(mark, options)
    assert "".join(canvas.char[cell(iid)] for iid in (0, 1, 4)) == glyphs
    plot = Plot(Scale(0.0, 10.0), Scale(0.0, 10.0), (mark,))
    assert legend in "\n".join(
        draw_cells(Drawing((plot,), notes=((),)), (100, 20), options).lines()
    )


def test_the_cursor_lies_on_top_and_unselected_points_do_not_hide_selected_ones():
    x = np.array([2.0, *[5.0] * 20, 5.0])
    selected = np.arange(22) == 21
    canvas, cell = drawn(points(x, np.full(22, 5.0), selected=selected, cursor=0))
    assert canvas.char[cell(0)] == "◉"
    assert (ord(canvas.char[cell(21)]) - 0x2800).bit_count() == 1
    canvas, _ = drawn(points([2.0, np.nan], [5.0, 5.0], cursor=1))
    assert "◉" not in "".join(canvas.lines())
