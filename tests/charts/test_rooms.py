"""The rooms view: counts per column, a row for no room, and scrolling."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.canvas import DARK, ColourMode, RenderOptions
from s2rtui.canvas.marks import Mark
from s2rtui.charts.rooms.model import rooms_model
from s2rtui.charts.rooms.terminal import draw_rooms, rooms_layout, rooms_panels
from tests.charts.examples import ROOM_NAMES, N, rooms_input

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
def test_counts_equal_those_of_each_column(sim, truth, real, selected, valid) -> None:
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


def test_labels_show_selected_and_total_counts() -> None:
    lines = draw_rooms(rooms_input(), SIZE).lines()
    assert lines[1].split()[0] == "hall"
    assert [word for word in lines[1].split() if "/" in word][:2] == ["11/11", "11/11"]
    assert "no room" in lines[6]


def test_bar_lengths_are_proportional_to_counts() -> None:
    column = np.repeat([0, 1, 2], [32, 16, 12]).astype(np.int32)
    selected = np.arange(N) < 40
    view = rooms_input(
        sim=column,
        truth=column,
        real=column,
        room_names=("a", "b", "c"),
        selected=selected,
        valid=np.ones(N, dtype=np.bool_),
        cursor=None,
    )
    canvas = draw_rooms(view, (76, 4), RenderOptions(mode=ColourMode.NONE))
    layout = rooms_layout(view, (76, 4))
    for x, _ in layout.columns:
        bar = slice(x + layout.gutter, x + layout.gutter + layout.bar)
        for row, (highlighted, total) in enumerate(((32, 32), (8, 16), (0, 12)), start=1):
            inked = "".join(canvas.char[row, bar]).rstrip()
            assert len(inked) == -(-total * layout.bar // 32)
            assert abs(inked.count("█") - highlighted * layout.bar / 32) <= 1


def test_columns_have_the_colours_of_the_sides() -> None:
    view = rooms_input()
    canvas = draw_rooms(view, SIZE)
    for panel, colour in zip(
        rooms_panels(view, SIZE), (DARK.sim, DARK.truth, DARK.real), strict=True
    ):
        panel_cells = (slice(panel.y, None), slice(panel.x, panel.x + panel.width))
        inked = canvas.char[panel_cells] != " "
        assert (canvas.fg[panel_cells][inked] == colour).all(axis=-1).any()


def test_the_visible_rooms_follow_the_cursor_and_the_brush() -> None:
    for cursor in (0, 17, 39):
        layout = rooms_layout(forty_rooms(cursor=cursor), SIZE)
        assert layout.first <= cursor < layout.first + layout.shown
        assert f"room {cursor}" in "\n".join(draw_rooms(forty_rooms(cursor=cursor), SIZE).lines())
    mark = Mark("sim", ((0.0, 2.0), (0.0, 30.0)))
    layout = rooms_layout(forty_rooms(cursor=0, mark=mark), SIZE)
    assert layout.first <= 30 < layout.first + layout.shown


@pytest.mark.parametrize("size", [(60, 9), (90, 30), (40, 6)])
def test_the_room_of_the_cursor_is_marked_in_each_column(size: tuple[int, int]) -> None:
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
def test_pending_rooms_are_marked_in_their_column(options: RenderOptions) -> None:
    view = rooms_input(mark=Mark("truth", ((0.0, 3.0), (0.0, 1.0))), cursor=20)
    canvas = draw_rooms(view, SIZE, options)
    pointers = np.argwhere(canvas.char == options.glyphs.pointer)
    _, truth, _ = rooms_panels(view, SIZE, options)
    steps = [truth.to_data(column + 0.5, row + 0.5)[1] for row, column in pointers.tolist()]
    assert steps == [1.0, 2.0, 3.0]
    assert all(column == truth.x for _, column in pointers.tolist())


def test_rooms_and_no_room_can_be_brushed() -> None:
    view = rooms_input()
    panel = rooms_panels(view, SIZE)[2]
    steps = [panel.to_data(panel.x, panel.y + row + 0.5)[1] for row in range(panel.height)]
    assert steps == [0.0, 1.0, 2.0, 3.0, 4.0, float(len(ROOM_NAMES))]


def test_a_store_without_rooms_shows_a_message() -> None:
    no_room = np.full(N, -1, dtype=np.int32)
    none_valid = np.zeros(N, dtype=np.bool_)
    view = rooms_input(sim=no_room, truth=no_room, real=no_room, room_names=(), valid=none_valid)
    assert "no rooms" in draw_rooms(view, SIZE).lines()[0]
    assert rooms_panels(view, SIZE) == ()
