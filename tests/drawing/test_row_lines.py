"""Instances as lines between the rows of a table: density, bands, bars, colours, rows apart."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.canvas import DARK, Canvas, ColourMode, RenderOptions
from s2rtui.canvas.marks import panel_at
from s2rtui.drawing.cells import draw_cells, drawing_panels
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.row_lines import MOST_LINES, QUANTILES, RowLines, layer_dots
from s2rtui.drawing.scale import Scale
from s2rtui.drawing.table import Cell, Column, Row, TableSpec

FEW = 12
SCALE = Scale(0.5, 1.0, ("share", ""))
SIZE = (60, 16)
columns = arrays.arrays(np.float64, FEW, elements=st.floats(0.3, 1.0) | st.just(np.nan))
masks = arrays.arrays(np.bool_, FEW)


def many(count: int = 400, **changes: object) -> RowLines:
    """Evenly spread values: 0.5 to 1 in the first row, 0.7 to 0.9 in the second."""
    spread, whole = np.linspace(0, 1, count), np.ones(count, dtype=np.bool_)
    return replace(RowLines((0.5 + 0.5 * spread, 0.7 + 0.2 * spread), whole, whole, "real"),
                   **changes)  # fmt: skip


def drawing(lines: RowLines | None, rows: int = 2) -> Drawing:
    spec = Column("row"), Column("", scale=SCALE)
    names = tuple(Row((Cell(f"row {k}"), Cell()), name=f"row {k}") for k in range(rows))
    return Drawing(table=TableSpec(spec, names, lines=lines))


def drawn(lines: RowLines, options: RenderOptions | None = None) -> Canvas:
    return draw_cells(drawing(lines), SIZE, options or RenderOptions())


def dots_one_by_one(lines: RowLines, members: np.ndarray, width: int, step: int) -> np.ndarray:
    """How many lines cross each dot, found by following one line after the other."""
    grid = np.zeros((4 * ((len(lines.values) - 1) * step + 1), 2 * width))
    for iid in np.flatnonzero(members):
        for row in range(len(lines.values) - 1):
            ends = [(column[iid] - 0.5) / 0.5 for column in lines.values[row : row + 2]]
            if np.isnan(ends).any():
                continue
            start, stop = (min(2 * width * min(max(end, 0), 1), 2 * width - 1) for end in ends)
            places = [int(start + (stop - start) * at) for at in np.linspace(0, 1, 4 * step + 1)]
            for line, (first, last) in enumerate(pairwise(places)):
                dots = range(first, last) if last > first else range(last + 1, first + 1)
                for dot in dots if last != first else (first,):
                    grid[4 * row * step + 2 + line, dot] += 1
    return grid


@given(columns, columns, columns, masks, masks)
def test_each_line_is_counted_once_at_each_dot(first, second, third, selected, valid):
    lines = RowLines((first, second, third), selected, valid, "real", cursor=3)
    members = ~selected & valid, selected & valid, np.arange(FEW) == 3
    for layer, held in zip(lines.layers, members, strict=True):
        assert layer.size == held.sum()
        found = layer_dots(layer, SCALE, 20, 3)
        assert (found == dots_one_by_one(lines, held, 20, 3)).all()


@pytest.mark.parametrize("count", [MOST_LINES, MOST_LINES + 1])
def test_more_lines_than_sixty_are_bands(count):
    lines = many(count)
    assert lines.is_banded == (count > MOST_LINES)
    found = layer_dots(lines.layers[-1], SCALE, 40, 4)
    assert set(np.unique(found)) <= {0, 1, 2, 3} if lines.is_banded else found[5].sum() >= count
    assert lines.legend[0].text == f"{'bands' if lines.is_banded else 'lines'}: real"
    others, selected = many(selected=np.arange(400) < count).layers
    assert (others.is_banded, selected.is_banded) == (True, lines.is_banded)


def test_bands_lie_at_the_quantiles():
    layer = many().layers[-1]
    exact = np.array([np.quantile((column - 0.5) / 0.5, QUANTILES) for column in layer.values])
    np.testing.assert_allclose(layer.quantiles(SCALE), exact, atol=0.006)
    assert np.isnan(many().layers[0].quantiles(SCALE)).all()
    inner = layer_dots(layer, SCALE, 100, 10) >= 2
    for row, places in ((2, exact[0]), (-3, exact[1])):
        dots = np.flatnonzero(inner[row]) / 200
        assert (dots.min(), dots.max()) == pytest.approx((places[1], places[3]), abs=0.02)


def test_rows_that_follow_each_other_have_bars_of_their_instances():
    lines = many(selected=np.arange(400) < 100)
    others, selected = (layer_dots(layer, SCALE, 40, 1) for layer in lines.layers)
    assert others.shape == (8, 80)
    assert selected[3].sum() == pytest.approx(100)  # the lowest dots of the first row
    assert others[3].sum() == pytest.approx(300)
    assert selected[3, 20:].max() == 0
    assert (np.diff((others > 0)[:4], axis=0) >= 0).all()  # bars stand on the row


def test_selected_lines_are_coloured_and_others_grey():
    band = slice(2, 13)
    for ink, strongest in (("sim", 2), ("real", 0)):
        canvas = drawn(many(40, selected=np.arange(40) < 20, ink=ink))
        colours = canvas.fg[band][canvas.char[band] > "\u2800"].astype(int)
        highlighted = np.ptp(colours, axis=1) > 40
        assert highlighted.any()
        assert not highlighted.all()
        assert (colours[highlighted].argmax(axis=1) == strongest).all()


def test_trained_instances_are_paler():
    lines = many(40, trained=np.arange(40) < 20)
    canvas, plain = drawn(lines), drawn(lines, RenderOptions(ascii=True))
    assert canvas.fg[2:13, 10:25].max() < canvas.fg[2:13, 40:].max()
    assert plain.glyphs.trained in "".join(plain.lines())
    assert [phrase.text for phrase in lines.legend] == ["lines: real", "pale: trained on"]


def test_unselected_lines_are_fainter_without_colours():
    nothing, everything = many(40, selected=np.zeros(40, dtype=np.bool_)), many(40)

    def ink(lines: RowLines) -> int:
        text = "".join(drawn(lines, RenderOptions(mode=ColourMode.NONE)).lines())
        return sum((ord(glyph) - 0x2800).bit_count() for glyph in text if glyph > "\u2800")

    assert 0 < ink(nothing) < 0.75 * ink(everything)
    for lines, glyphs in ((nothing, "."), (everything, "'+*#")):
        shown = set("".join(drawn(lines, RenderOptions(ascii=True)).lines()[2:12])) - {" "}
        assert shown
        assert shown <= set(glyphs)


def test_the_line_of_the_cursor_is_on_top_and_ends_where_no_value_is():
    lines = many(40, cursor=30)
    white = (drawn(lines).fg == DARK.cursor).all(axis=-1) & (drawn(lines).char > "\u2800")
    assert white[2:13].any(axis=1).all()
    values = lines.values[0], np.where(np.arange(40) == 30, np.nan, lines.values[1])
    assert not (drawn(replace(lines, values=values)).fg == DARK.cursor).all(axis=-1).any()


@pytest.mark.parametrize(("height", "step"), [(3, 1), (9, 6), (16, 12), (60, 12)])
def test_rows_are_set_apart_where_there_is_room(height, step):
    lines = draw_cells(drawing(many()), (60, height)).lines()
    places = [
        next(y for y, line in enumerate(lines) if name in line) for name in ("row 0", "row 1")
    ]
    assert places[1] - places[0] == step
    plain = draw_cells(drawing(None), (60, height)).lines()
    assert plain[places[0] + 1].startswith("row 1")


def test_each_row_takes_ranges_as_far_as_half_way_to_its_neighbours():
    first, second = drawing_panels(drawing(many()), SIZE)
    assert first.y + first.height == second.y
    assert abs(first.height - second.height) <= 1
    for panel, own in ((first, 1), (second, 13)):
        assert panel_at((first, second), panel.x, own) == panel
        assert panel.to_data(panel.x + 0.5, own)[1] == 0.0
        assert panel.to_cells(0.75, 0.0) == pytest.approx((panel.x + panel.width / 2, own))
