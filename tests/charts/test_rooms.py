"""The rooms view: counts per room, errors per group, their order and the row of the cursor."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rstore.findings.groups import Group, Groups
from s2rstore.intervals import Interval, Sample
from s2rstore.language.syntax_tree import Everything
from s2rtui.canvas.marks import BrushShape
from s2rtui.charts.rooms import _numbers, independent, ordered, room_counts, selected_per_group
from s2rtui.drawing.cells import draw_cells, drawing_panels
from s2rtui.session.error_groups import COLUMN_NAMES
from tests.charts.examples import (
    GROUP_COUNTS,
    ROOM_NAMES,
    counts_drawing,
    group_errors,
    groups_drawing,
)

COUNT = 30
codes = arrays.arrays(np.int32, COUNT, elements=st.integers(-1, 4))
masks = arrays.arrays(np.bool_, COUNT)


@given(codes, codes, codes, masks, masks)
def test_counts_equal_those_of_each_column(sim, truth, real, selected, valid):
    part, whole = room_counts((sim, truth, real), 5, selected, valid)
    for index, column in enumerate((sim, truth, real)):
        for mask, counts in ((valid, whole), (selected & valid, part)):
            expected = Counter(column[mask].tolist())
            assert counts[index].tolist() == [*(expected[room] for room in range(5)), expected[-1]]


@pytest.mark.parametrize("size", [(60, 9), (90, 30)])
def test_brushed_rooms_and_the_room_of_the_cursor_are_marked_in_their_columns(size):
    drawing = counts_drawing(BrushShape("truth", ((0.0, 3.0), (0.0, 1.0))))
    canvas = draw_cells(drawing, size)
    panels = drawing_panels(drawing, size)
    marked = {"◉": [[4.0], [4.0], [5.0]], "▶": [[], [1.0, 2.0, 3.0], []]}
    for glyph, expected in marked.items():
        found = [
            [panel.to_data(column + 0.5, row + 0.5)[1]
             for row, column in np.argwhere(canvas.char == glyph).tolist()
             if panel.holds(column, row)]
            for panel in panels
        ]  # fmt: skip
        assert found == expected


@pytest.mark.parametrize("descending", [True, False])
@pytest.mark.parametrize("sort", COLUMN_NAMES)
def test_groups_are_sorted_by_each_column_which_is_shown_at_every_width(sort, descending):
    values = {
        "real_m": lambda row: row.real.value, "low_m": lambda row: row.real.low,
        "high_m": lambda row: row.real.high, "sim_m": lambda row: row.sim,
        "gap_m": lambda row: row.gap, "n": lambda row: row.n, "independent": independent,
        "selected": lambda row: GROUP_COUNTS.get(row.group.name, 0),
        "group": lambda row: ROOM_NAMES.index(row.group.name),
    }  # fmt: skip
    rows = ordered(group_errors(), sort, descending, GROUP_COUNTS)
    column = np.array([values[sort](row) for row in rows], dtype=np.float64)
    known = column[~np.isnan(column)]
    assert np.array_equal(known, np.sort(known)[:: -1 if descending else 1])
    assert np.isnan(column[known.size :]).all()
    for width in range(30, 110, 20):
        head = draw_cells(groups_drawing(sort, descending), (width, 8)).lines()[0]
        assert ("▼" if descending else "▲") in head


@pytest.mark.parametrize("size", [(80, 24), (200, 60)])
def test_each_row_shows_median_interval_and_count(size):
    lines = draw_cells(groups_drawing(), size).lines()
    hall = next(line for line in lines if "hall" in line)
    for text in ("2.00", "1.00..3.50", "0.40", "+1.60", "12"):
        assert text in hall.split()
    alone = next(line for line in lines if line.split()[:1] == ["5"])
    assert alone.split()[1:4] == ["1.00", "too", "few"]


def test_rows_mark_bounds_beyond_all_values():
    sample = Sample(30, 12.34, 1)
    unbounded = Interval(-np.inf, 2.0, np.inf, ends=(0.4, 9.25), sample=sample)
    row = _numbers(replace(group_errors()[0], real=unbounded), GROUP_COUNTS)
    assert [f"{bound:.4g}" for bound in row[2:4]] == ["<0.4", ">9.25"]
    assert (row[7], row[-1]) == (12.3, "")
    few = replace(unbounded, low=np.nan, high=np.nan, reason="n 7, a median needs 25", sample=None)
    row = _numbers(replace(group_errors()[0], real=few), GROUP_COUNTS)
    assert (row[7], row[-1]) == (None, "no interval: n 7, a median needs 25")


def test_selected_instances_are_counted_per_group():
    named = tuple(Group(name, Everything()) for name in ("a", "b", "c"))
    grouped = Groups("room", named, np.array([0, 1, 1, -1, 0]))
    members = np.array([True, True, True, True, False])
    everyone = np.ones(5, dtype=np.bool_)
    assert selected_per_group(grouped, members, everyone) == {"a": 1, "b": 2, "c": 0}
    assert selected_per_group(grouped, everyone, members) == {"a": 1, "b": 2, "c": 0}
