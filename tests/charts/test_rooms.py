"""The rooms view: errors per group, their order and bounds."""

from dataclasses import replace

import numpy as np
import pytest

from s2rstore.intervals import Interval, Sample
from s2rtui.charts.rooms import _numbers, independent, ordered
from s2rtui.drawing.cells import draw_cells
from s2rtui.session.error_groups import COLUMN_NAMES
from tests.charts.examples import GROUP_COUNTS, ROOM_NAMES, group_errors, groups_drawing


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


def test_rows_mark_bounds_beyond_all_values():
    sample = Sample(30, 12.34, 1)
    unbounded = Interval(-np.inf, 2.0, np.inf, ends=(0.4, 9.25), sample=sample)
    row = _numbers(replace(group_errors()[0], real=unbounded), GROUP_COUNTS)
    assert [f"{bound:.4g}" for bound in row[2:4]] == ["<0.4", ">9.25"]
    assert (row[7], row[-1]) == (12.3, "")
    few = replace(unbounded, low=np.nan, high=np.nan, reason="n 7, a median needs 25", sample=None)
    row = _numbers(replace(group_errors()[0], real=few), GROUP_COUNTS)
    assert (row[7], row[-1]) == (None, "no interval: n 7, a median needs 25")
