"""The rooms view: counts per room, errors per group, order, marks and scrolling."""

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
from s2rtui.canvas import DARK, ColourMode, RenderOptions
from s2rtui.canvas.marks import Mark
from s2rtui.charts.rooms.groups import fitting_columns, independent, ordered, selected_per_group
from s2rtui.charts.rooms.groups_terminal import draw_groups, groups_layout, groups_panels
from s2rtui.charts.rooms.model import rooms_model
from s2rtui.charts.rooms.terminal import draw_rooms, rooms_layout, rooms_panels
from s2rtui.charts.rooms.view import _row
from s2rtui.session.error_groups import COLUMN_NAMES
from tests.charts.examples import ROOM_NAMES, N, groups_input, rooms_input

SIZE = (60, 9)
COUNT = 30
codes = arrays.arrays(np.int32, COUNT, elements=st.integers(-1, 4))
masks = arrays.arrays(np.bool_, COUNT)
FORTY_ROOM_NAMES = tuple(f"room {index}" for index in range(40))


def forty_rooms(**changes):
    """Forty rooms with one or two instances each."""
    column = (np.arange(N) % 40).astype(np.int32)
    view = {"sim": column, "truth": column, "real": column, "room_names": FORTY_ROOM_NAMES}
    return rooms_input(**(view | changes))


@given(codes, codes, codes, masks, masks)
def test_counts_equal_those_of_each_column(sim, truth, real, selected, valid):
    view = rooms_input(sim=sim, truth=truth, real=real, selected=selected, valid=valid, cursor=None)
    model = rooms_model(view)
    for index, column in enumerate((sim, truth, real)):
        for mask, counts in ((valid, model.total), (selected & valid, model.highlighted)):
            expected = Counter(column[mask].tolist())
            shown = {room: expected[room] for room in range(5)}
            if len(model.names) == 6:
                shown[5] = expected[-1]
            assert dict(enumerate(counts[index].tolist())) == shown
    has_no_room = any((column[valid] == -1).any() for column in (sim, truth, real))
    assert (model.names[-1] == "no room") == has_no_room


def test_bar_lengths_are_proportional_to_counts():
    column = np.repeat([0, 1, 2], [32, 16, 12]).astype(np.int32)
    selected = np.arange(N) < 40
    view = rooms_input(
        sim=column, truth=column, real=column, room_names=("a", "b", "c"), selected=selected,
        valid=np.ones(N, dtype=np.bool_), cursor=None,
    )  # fmt: skip
    canvas = draw_rooms(view, (76, 4), RenderOptions(mode=ColourMode.NONE))
    layout = rooms_layout(view, (76, 4))
    for x, _ in layout.columns:
        bar = slice(x + layout.gutter, x + layout.gutter + layout.bar)
        for row, (highlighted, total) in enumerate(((32, 32), (8, 16), (0, 12)), start=1):
            inked = "".join(canvas.char[row, bar]).rstrip()
            assert len(inked) == -(-total * layout.bar // 32)
            assert abs(inked.count("█") - highlighted * layout.bar / 32) <= 1


def test_the_visible_rooms_follow_the_cursor_and_the_brush():
    for cursor in (0, 17, 39):
        layout = rooms_layout(forty_rooms(cursor=cursor), SIZE)
        assert layout.first <= cursor < layout.first + layout.shown
        assert f"room {cursor}" in "\n".join(draw_rooms(forty_rooms(cursor=cursor), SIZE).lines())
    mark = Mark("sim", ((0.0, 2.0), (0.0, 30.0)))
    layout = rooms_layout(forty_rooms(cursor=0, mark=mark), SIZE)
    assert layout.first <= 30 < layout.first + layout.shown


@pytest.mark.parametrize("size", [(60, 9), (90, 30), (40, 6)])
def test_the_room_of_the_cursor_is_marked_in_each_column(size):
    view = rooms_input(cursor=40)
    canvas = draw_rooms(view, size)
    panels = rooms_panels(view, size)
    for panel, column in zip(panels, (view.sim, view.truth, view.real), strict=True):
        rooms_marked = [
            panel.to_data(column_at + 0.5, row + 0.5)[1]
            for row, column_at in np.argwhere(canvas.char == "◉").tolist()
            if panel.holds(column_at, row)
        ]
        room = int(column[40])
        assert rooms_marked == [room if room >= 0 else len(ROOM_NAMES)]


@pytest.mark.parametrize(
    "options", [RenderOptions(), RenderOptions(mode=ColourMode.NONE), RenderOptions(ascii=True)]
)
def test_pending_rooms_are_marked_in_their_column(options):
    view = rooms_input(mark=Mark("truth", ((0.0, 3.0), (0.0, 1.0))), cursor=20)
    canvas = draw_rooms(view, SIZE, options)
    pointers = np.argwhere(canvas.char == options.glyphs.pointer)
    _, truth, _ = rooms_panels(view, SIZE, options)
    steps = [truth.to_data(column + 0.5, row + 0.5)[1] for row, column in pointers.tolist()]
    assert steps == [1.0, 2.0, 3.0]
    assert all(column == truth.x for _, column in pointers.tolist())


def test_rooms_and_no_room_can_be_brushed():
    view = rooms_input()
    panel = rooms_panels(view, SIZE)[2]
    steps = [panel.to_data(panel.x, panel.y + row + 0.5)[1] for row in range(panel.height)]
    assert steps == [0.0, 1.0, 2.0, 3.0, 4.0, float(len(ROOM_NAMES))]


def test_a_store_without_rooms_shows_a_message():
    no_room = np.full(N, -1, dtype=np.int32)
    none_valid = np.zeros(N, dtype=np.bool_)
    view = rooms_input(sim=no_room, truth=no_room, real=no_room, room_names=(), valid=none_valid)
    assert "no rooms" in draw_rooms(view, SIZE).lines()[0]
    assert rooms_panels(view, SIZE) == ()


@pytest.mark.parametrize("descending", [True, False])
@pytest.mark.parametrize("sort", COLUMN_NAMES)
def test_groups_are_sorted_by_each_column(sort, descending):
    data = groups_input(sort=sort, descending=descending)
    values = {
        "real_m": lambda row: row.real.value, "low_m": lambda row: row.real.low,
        "high_m": lambda row: row.real.high, "sim_m": lambda row: row.sim,
        "gap_m": lambda row: row.gap, "n": lambda row: row.n, "independent": independent,
        "selected": lambda row: data.selected.get(row.group.name, 0),
        "group": lambda row: ROOM_NAMES.index(row.group.name),
    }  # fmt: skip
    column = np.array([values[sort](row) for row in ordered(data)], dtype=np.float64)
    known = column[~np.isnan(column)]
    assert np.array_equal(known, np.sort(known)[:: -1 if descending else 1])
    assert np.isnan(column[known.size :]).all()


@pytest.mark.parametrize("size", [(80, 24), (200, 60)])
def test_each_row_shows_median_interval_and_count(size):
    lines = draw_groups(groups_input(), size).lines()
    hall = next(line for line in lines if "hall" in line)
    for text in ("2.00", "1.00..3.50", "0.40", "+1.60", "12"):
        assert text in hall.split()
    alone = next(line for line in lines if line.split()[:1] == ["5"])
    assert alone.split()[1:4] == ["1.00", "too", "few"]


def test_rows_mark_bounds_beyond_all_values():
    data = groups_input()
    sample = Sample(30, 12.34, 1)
    unbounded = Interval(-np.inf, 2.0, np.inf, ends=(0.4, 9.25), sample=sample)
    row = _row(replace(data.rows[0], real=unbounded), data)
    assert [f"{bound:.4g}" for bound in row[2:4]] == ["<0.4", ">9.25"]
    assert (row[7], row[-1]) == (12.3, "")
    few = replace(unbounded, low=np.nan, high=np.nan, reason="n 7, a median needs 25", sample=None)
    row = _row(replace(data.rows[0], real=few), data)
    assert (row[7], row[-1]) == (None, "no interval: n 7, a median needs 25")


@pytest.mark.parametrize("sort", COLUMN_NAMES[:-1])
def test_the_sorted_column_is_shown_at_every_width(sort):
    data = groups_input(sort=sort)
    for width in range(20, 100, 7):
        columns = fitting_columns(data, ordered(data), width)
        assert not columns or any(sort in column.sorts for column in columns), width


def test_names_are_not_cut_where_a_column_can_be_left_out():
    data = groups_input(rows=tuple(row for row in groups_input().rows if len(row.group.name) < 9))
    lines = draw_groups(data, (48, 9)).lines()
    assert all(any(row.group.name in line for line in lines) for row in data.rows)


def test_the_window_follows_the_brush():
    data = groups_input(mark=Mark("groups", ((0.0, 4.0), (0.0, 4.0))))
    layout = groups_layout(data, (60, 3))
    assert layout.first <= 4 < layout.first + layout.shown
    assert ordered(data)[4].group.name[:12] in "\n".join(draw_groups(data, (60, 3)).lines())


def test_the_scale_shows_sim_and_real_in_their_colours():
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


def test_a_run_that_was_trained_on_everything_says_so():
    canvas = draw_groups(groups_input(rows=(), has_trained=True), (60, 5))
    assert "no instance is new to the run: M includes them" in canvas.lines()[0]
    assert groups_panels(groups_input(rows=()), (60, 5)) == ()


def test_selected_instances_are_counted_per_group():
    named = tuple(Group(name, Everything()) for name in ("a", "b", "c"))
    grouped = Groups("room", named, np.array([0, 1, 1, -1, 0]))
    members = np.array([True, True, True, True, False])
    assert selected_per_group(grouped, members) == {"a": 1, "b": 2, "c": 0}
