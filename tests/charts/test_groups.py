"""The table of errors per group: order, columns that fit, marks and brushes."""

from __future__ import annotations

import numpy as np
import pytest

from s2rtui.canvas import DARK, LIGHT
from s2rtui.canvas.marks import Mark
from s2rtui.charts.rooms.groups import fitting_columns, ordered, selected_per_group
from s2rtui.charts.rooms.groups_paper import groups_figure
from s2rtui.charts.rooms.groups_terminal import draw_groups, groups_layout, groups_panels
from s2rtui.session.error_groups import COLUMN_NAMES
from tests.charts.examples import ROOM_NAMES, groups_input

SIZES = ((80, 24), (120, 40), (200, 60))


@pytest.mark.parametrize("descending", [True, False])
@pytest.mark.parametrize("sort", COLUMN_NAMES)
def test_groups_are_sorted_by_each_column(sort: str, descending: bool) -> None:
    data = groups_input(sort=sort, descending=descending)
    values = {
        "real_m": lambda row: row.real.value, "low_m": lambda row: row.real.low,
        "high_m": lambda row: row.real.high, "sim_m": lambda row: row.sim,
        "gap_m": lambda row: row.gap, "n": lambda row: row.n,
        "selected": lambda row: data.selected.get(row.group.name, 0),
        "group": lambda row: ROOM_NAMES.index(row.group.name),
    }  # fmt: skip
    column = np.array([values[sort](row) for row in ordered(data)], dtype=np.float64)
    known = column[~np.isnan(column)]
    assert np.array_equal(known, np.sort(known)[:: -1 if descending else 1])
    assert np.isnan(column[known.size :]).all()


@pytest.mark.parametrize("size", SIZES)
def test_each_row_shows_median_interval_and_count(size: tuple[int, int]) -> None:
    lines = draw_groups(groups_input(), size).lines()
    hall = next(line for line in lines if "hall" in line)
    for text in ("2.00", "1.00..3.50", "0.40", "+1.60", "12"):
        assert text in hall.split()
    alone = next(line for line in lines if line.split()[:1] == ["5"])
    assert alone.split()[1:3] == ["1.00", "-"]


@pytest.mark.parametrize("sort", COLUMN_NAMES[:-1])
@pytest.mark.parametrize("width", range(20, 100, 7))
def test_the_sorted_column_is_shown_at_every_width(width: int, sort: str) -> None:
    data = groups_input(sort=sort)
    columns = fitting_columns(data, ordered(data), width)
    if columns:
        assert any(sort in column.sorts for column in columns)


def test_names_are_not_cut_where_a_column_can_be_left_out() -> None:
    data = groups_input(rows=tuple(row for row in groups_input().rows if len(row.group.name) < 9))
    lines = draw_groups(data, (48, 9)).lines()
    assert all(any(row.group.name in line for line in lines) for row in data.rows)


def test_the_window_follows_the_brush() -> None:
    data = groups_input(mark=Mark("groups", ((0.0, 4.0), (0.0, 4.0))))
    layout = groups_layout(data, (60, 3))
    assert layout.first <= 4 < layout.first + layout.shown
    assert ordered(data)[4].group.name[:12] in "\n".join(draw_groups(data, (60, 3)).lines())


def test_the_scale_shows_sim_and_real_in_their_colours() -> None:
    canvas = draw_groups(groups_input(), (120, 9))
    layout = groups_layout(groups_input(), (120, 9))
    assert layout.plot is not None
    left, width = layout.plot
    for y, row in enumerate(layout.rows, start=1):
        for glyph, value, colour in (("●", row.real.value, DARK.real), ("◆", row.sim, DARK.sim)):
            column = left + round(value / 120.0 * (width - 1))
            if canvas.char[y, column] == glyph:
                assert tuple(canvas.fg[y, column]) == colour
            else:
                assert canvas.char[y, column] == "●"  # the real median lies on the sim median


def test_a_run_that_was_trained_on_everything_says_so() -> None:
    canvas = draw_groups(groups_input(rows=(), has_trained=True), (60, 5))
    assert "no instance is new to the run: M includes them" in canvas.lines()[0]
    assert groups_panels(groups_input(rows=()), (60, 5)) == ()


def test_selected_instances_are_counted_per_group() -> None:
    from s2rstore.findings.groups import Group, Groups
    from s2rstore.language.syntax_tree import Everything

    named = tuple(Group(name, Everything()) for name in ("a", "b", "c"))
    grouped = Groups("room", named, np.array([0, 1, 1, -1, 0]))
    members = np.array([True, True, True, True, False])
    assert selected_per_group(grouped, members) == {"a": 1, "b": 2, "c": 0}


def test_no_groups_can_be_drawn_on_paper() -> None:
    assert groups_figure(groups_input(rows=()), (300, 200), LIGHT)
