"""Tables: windows, columns that fit, strips, wrapped texts and notes, and their panels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.lazy_sequence import LazySequence
from s2rtui.canvas import DARK, LIGHT, Canvas, ColourMode, RenderOptions
from s2rtui.drawing.cells import draw_cells, drawing_panels
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.paper import draw_paper
from s2rtui.drawing.scale import Scale
from s2rtui.drawing.table import Bar, Cell, Column, Dot, Row, Span, TableSpec
from s2rtui.drawing.table_cells import draw_axis
from s2rtui.drawing.table_layout import table_layout
from s2rtui.drawing.table_paper import page_layout
from tests.charts.examples import findings_of, groups_drawing, list_drawing


@given(st.integers(24, 60), st.integers(2, 80), st.none() | st.integers(0, 59))
def test_each_line_shows_the_row_of_its_panel(width, height, cursor):
    drawing = list_drawing(cursor)
    canvas = draw_cells(drawing, (width, height))
    (panel,) = drawing_panels(drawing, (width, height))
    for y in range(panel.y, panel.y + panel.height):
        row = int(panel.to_data(3.5, y + 0.5)[1])
        expected = [cell.text for cell in drawing.table.rows[row].cells]
        shown = canvas.lines()[y].replace("▶", " ").split()
        assert shown == " ".join(expected).split()[: len(shown)]
        assert panel.to_cells(0.0, row)[1] == y + 0.5
    if cursor is not None:
        lit = (canvas.bg == RenderOptions().theme.highlight).all(axis=-1).all(axis=1)
        rows = [int(panel.to_data(0, y + 0.5)[1]) for y in np.flatnonzero(lit).tolist()]
        assert [drawing.table.rows[row].cells[0].text for row in rows] == [str(cursor)]


def test_only_visible_rows_of_a_long_table_are_made():
    made: list[int] = []

    def row(place: int) -> Row:
        made.append(place)
        return Row((Cell(str(place)),))

    columns = (Column("n", least=24),)
    table = TableSpec(columns, LazySequence(1_000_000, row), "rows", chosen=500_000)
    lines = draw_cells(Drawing(table=table), (30, 12)).lines()
    assert lines[0].split() == ["499996-500006/1000000"]
    assert set(made) == set(range(499_995, 500_006))


@pytest.mark.parametrize(("changes", "row"), [({"brushed": (2, 30)}, 30), ({"chosen": 17}, 17)])
def test_the_window_follows_the_brush_and_the_chosen_row(changes, row):
    layout = table_layout(replace(list_drawing().table, **changes), 60, 9)
    assert layout.first <= row < layout.first + layout.shown


def test_columns_of_the_largest_rank_are_left_out_before_names_are_cut():
    drawing = groups_drawing()
    for width in range(30, 130, 5):
        lines = draw_cells(drawing, (width, 9)).lines()
        assert "kitchen" in " ".join(lines)
        columns = table_layout(drawing.table, width, 9).columns
        ranks = [column.rank for column in drawing.table.columns]
        left_out = [rank for place, rank in enumerate(ranks) if place not in columns]
        assert max(ranks[place] for place in columns) < min(left_out, default=99)
    on_paper = page_layout(drawing.table, 40).columns
    assert [place for place in on_paper if drawing.table.columns[place].scale]


def test_columns_come_nearer_before_one_is_left_out():
    columns = Column("run"), Column("n", right=True, rank=1), Column("gap m", right=True, rank=2)
    table = TableSpec(columns, (Row((Cell("vanilla"), Cell("100"), Cell("+0.25"))),))
    rows = [draw_cells(Drawing(table=table), (width, 2)).lines()[1] for width in (19, 17, 16)]
    assert [row.strip() for row in rows] == [
        "vanilla  100  +0.25", "vanilla 100 +0.25", "vanilla  100"
    ]  # fmt: skip


def test_strips_show_bars_intervals_and_dots_on_one_scale():
    scale = Scale(-2.0, 2.0, ("gain (m)",))
    marks = (Bar(1.0, "real"), Span(-1.0, 9.0, "text"), Dot(0.0, "truth", "truth"))
    table = TableSpec((Column("factor"), Column("", scale=scale)),
                      (Row((Cell("light"), Cell("+1.00 m", strip=marks))),))  # fmt: skip
    line = draw_cells(Drawing(table=table), (60, 3)).lines()[1]
    assert line.startswith("light")
    assert line.rstrip().endswith("+1.00 m")
    strip = line[7 : -len("+1.00 m") - 1].ljust(44)
    unit = len(strip) / 4
    places = {glyph: strip.index(glyph) for glyph in "─•>"}
    assert places["─"] == pytest.approx(unit, abs=1)
    assert places["•"] == pytest.approx(2 * unit, abs=1)
    assert strip.count("█") + 1 == pytest.approx(unit, abs=2)
    assert places[">"] == len(strip) - 1  # the interval ends beyond the scale


def test_a_dot_beyond_the_scale_is_at_its_end_on_paper():
    pages = []
    for at in (-3.0, 0.0):
        cells = Cell("light"), Cell(strip=(Dot(at, "cursor", "cursor"),))
        table = TableSpec((Column("factor"), Column("", scale=Scale(0.0, 2.0))), (Row(cells),))
        pages.append(draw_paper(Drawing(table=table), (300, 200), LIGHT))
    assert pages[0] == pages[1]


def test_bars_from_the_left_edge_have_eighths_of_cells():
    scale = Scale(0.0, 32.0)
    rows = tuple(
        Row((Cell(str(whole)), Cell(f"{part}/{whole}", strip=(Bar(part, "sim", whole),))))
        for part, whole in ((32, 32), (8, 16), (0, 12))
    )
    table = TableSpec((Column("n"), Column("sim", "sim", scale=scale)), rows)
    canvas = draw_cells(Drawing(table=table), (60, 4), RenderOptions(mode=ColourMode.NONE))
    lengths = [len(line[4:-6].rstrip()) for line in canvas.lines()[1:]]
    assert lengths == [-(-whole * lengths[0] // 32) for whole in (32, 16, 12)]


@pytest.mark.parametrize("chosen", [0, 3, 7, 11])
def test_the_chosen_entry_is_visible_and_highlighted_and_keeps_its_notes(chosen):
    canvas = draw_cells(findings_of(12, chosen), (82, 5))
    lines = canvas.lines()
    row = next(y for y, line in enumerate(lines) if f"kind {chosen + 1} " in line)
    assert tuple(canvas.bg[row, 5]) == DARK.highlight
    assert lines[-1].rstrip().endswith("…") == (chosen < 11)
    layout = table_layout(findings_of(4, 2).table, 82, 7)
    assert {line.row for line in layout.lines if line.is_note} == {2}


def test_an_axis_keeps_two_numbers_beside_its_name():
    canvas = Canvas(40, 3)
    draw_axis(canvas, Scale(0.1, 0.95, ("a long name of it (m)",), log=True), 0, 0, 40, 4)
    draw_axis(canvas, Scale(0.0, 2.43, ("median error (m)", "error (m)", "m")), 0, 1, 20, 2)
    draw_axis(canvas, Scale(-0.32, 0.01, ("median gain (m)", "gain (m)")), 0, 2, 20, 2)
    assert any(letter.isdigit() for letter in canvas.lines()[0])
    assert [line.split() for line in canvas.lines()[1:]] == [
        ["0", "1", "error", "(m)"], ["-0.3", "-0.2", "gain", "(m)"]
    ]  # fmt: skip
