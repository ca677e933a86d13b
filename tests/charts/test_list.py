"""The list view: row order, cursor position and conversion of cells to rows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.reader import Store
from s2rtui.canvas import RenderOptions
from s2rtui.charts.list.model import ListColumn, ListInput
from s2rtui.charts.list.terminal import draw_list, list_layout, list_panels
from s2rtui.charts.list.view import VIEW
from s2rtui.charts.scene import Resources, Scene
from s2rtui.session import Session, State, instance_list

ROWS = np.random.default_rng(5).permutation(60)
COLUMNS = (
    ListColumn("iid", str, 6),
    ListColumn("error", lambda iid: f"{iid / 7:.2f}", 8, sorts=True),
    ListColumn("room", lambda iid: f"room {iid}", 10, right=False),
)


@given(st.integers(16, 60), st.integers(2, 80), st.none() | st.sampled_from(ROWS.tolist()))
def test_each_line_shows_the_row_of_its_position(width, height, cursor):
    view = ListInput(ROWS, COLUMNS, cursor)
    canvas, layout = draw_list(view, (width, height)), list_layout(view, (width, height))
    lines = canvas.lines()
    for y in range(height):
        row_index = layout.row_at(y)
        cells_of_line = lines[y].split()
        if row_index is None:
            assert y == 0 or not cells_of_line
        else:
            iid = int(ROWS[row_index])
            expected = [str(iid), f"{iid / 7:.2f}", "room", str(iid)]
            assert (
                cells_of_line[int(iid == cursor) :]
                == expected[: len(cells_of_line) - int(iid == cursor)]
            )
    if cursor is not None:
        marked = (canvas.bg == RenderOptions().theme.highlight).all(axis=-1).all(axis=1)
        assert [int(ROWS[layout.row_at(int(y)) or 0]) for y in np.flatnonzero(marked)] == [cursor]


@given(st.integers(16, 60), st.integers(2, 80), st.sampled_from(ROWS.tolist()))
def test_cells_convert_to_rows_and_back(width, height, cursor):
    view = ListInput(ROWS, COLUMNS, cursor)
    (panel,) = list_panels(view, (width, height))
    layout = list_layout(view, (width, height))
    for y in range(layout.top, layout.top + layout.shown):
        _, row = panel.to_data(3.5, y + 0.5)
        assert row == layout.row_at(y)
        assert panel.to_cells(0.0, row)[1] == y + 0.5


@pytest.mark.parametrize(("descending", "arrow", "plain"), [(True, "▼", "v"), (False, "▲", "^")])
def test_the_sorted_column_shows_the_direction(descending, arrow, plain):
    view = ListInput(ROWS, COLUMNS, None, descending)
    assert draw_list(view, (40, 5)).lines()[0].split() == ["iid", f"error{arrow}", "room"]
    assert f"error{plain}" in draw_list(view, (40, 5), RenderOptions(ascii=True)).lines()[0]


def test_an_empty_list_shows_a_message():
    view = ListInput(ROWS[:0], COLUMNS)
    assert draw_list(view, (40, 5)).lines()[0].strip() == "nothing is selected"
    assert list_panels(view, (40, 5)) == ()


def test_each_column_is_converted_once(tiny_store, monkeypatch):
    session = Session(tiny_store)
    session.select("all")
    scene = Scene(session.store, session.state, Resources())
    converted: list[str] = []
    column = instance_list.column

    def counted(store: Store, state: State, name: str) -> np.ndarray:
        converted.append(name)
        return column(store, state, name)

    monkeypatch.setattr(instance_list, "column", counted)
    _, rows = VIEW.numbers(scene)
    assert len(rows) == 40
    assert len(set(converted)) > 5
    assert max(map(converted.count, converted)) <= 2  # once for the order of the rows
    converted.clear()
    VIEW.draw(scene, (200, 30), RenderOptions())
    assert max(map(converted.count, converted)) <= 2  # once for the order of the rows
