"""Findings, grouped errors and rows of tables in the application."""

from pathlib import Path

import numpy as np
import pytest
from textual.events import MouseScrollDown, MouseScrollUp

from s2rstore.records import Room
from s2rtui.app.action import key_name
from s2rtui.app.key_bindings import footer
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.charts.compare import VIEW as COMPARE
from s2rtui.charts.registry import BY_NAME
from s2rtui.charts.rooms import VIEW
from s2rtui.session import navigation
from s2rtui.session.error_groups import COLUMN_NAMES, GROUPINGS
from s2rtui.session.session import Session
from tests.support import tiny
from tests.support.application import make_app, press, running


async def test_each_finding_is_one_key_away_from_its_instances(tiny_store):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        report = app.loaded.findings
        for number, finding in enumerate(report.findings):
            await press(app, pilot, "I", *["down"] * (number > 0), "enter")
            state = app.session.state
            assert not state.is_error
            assert state.run == finding.run
            assert finding.text in state.message
            if finding.grouping is not None:
                assert state.grouping == finding.grouping
            if finding.expression is not None:
                assert state.expression == finding.expression
                assert np.count_nonzero(state.selected) == finding.n
            if state.run != report.run:
                await press(app, pilot, "R")


async def test_the_first_wide_screen_shows_the_findings(tiny_store):
    async with running(tiny_store, size=(200, 60)) as (app, pilot):
        text = " ".join(take_screenshot(app).text.split())
        report = app.loaded.findings
        assert all(finding.kind in text for finding in report.findings)
        assert "I findings" in text
        await press(app, pilot, "f1", "enter")
        assert report.findings[0].text in app.session.state.message


async def test_the_chosen_finding_wraps_around_and_is_about_all_trajectories(tiny_store):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "t", "I", "up")
        assert app.session.state.trajectories is not None
        last = app.loaded.findings.findings[-1]
        await press(app, pilot, "enter")
        assert last.text in app.session.state.message
        assert app.session.state.trajectories is None


async def test_the_rooms_view_groups_and_sorts_by_keys(tiny_store):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "6")
        for grouping in (*GROUPINGS[1:], GROUPINGS[0]):
            await press(app, pilot, "O")
            assert app.session.state.grouping == grouping
        for second in (",heading", ",curvature", ",trajectory", ""):
            await press(app, pilot, "asterisk")
            assert app.session.state.grouping == f"room{second}"
        sort = app.session.state.sort
        for name in (*COLUMN_NAMES[1:], COLUMN_NAMES[0]):
            await press(app, pilot, "full_stop")
            assert app.session.state.group_sort == name
            assert app.session.state.sort == sort
        before = take_screenshot(app).text
        await press(app, pilot, "comma")
        assert not app.session.state.group_descending
        assert take_screenshot(app).text != before
        await press(app, pilot, "8", "full_stop")
        assert app.session.state.sort != sort


async def test_every_grouping_can_be_brushed_and_enter_selects_the_row_of_the_instance(tiny_store):
    app, other = make_app(tiny_store), Session(tiny_store)
    async with app.run_test(size=(120, 40)) as pilot:
        await press(app, pilot, "6")
        for number, grouping in enumerate(GROUPINGS):
            await press(app, pilot, "c", *["O"] * (number > 0))
            cursor = app.session.state.cursor
            if grouping != "counts":  # a table with a row per group
                await press(app, pilot, "enter")
                state = app.session.state
                assert state.expression != "all", grouping
                assert state.message == f"selected {state.expression}: {state.count_text}"
                assert state.selected[cursor]
            await press(app, pilot, "c", "x", "enter")
            state = app.session.state
            assert state.grouping == grouping
            assert not state.is_error, grouping
            assert state.expression != "all", grouping
            selected = other.select(state.expression).selected
            assert np.array_equal(selected, state.selected), grouping
    other.close()


ROOMS = tuple(f"room {letter}" for letter in "abcdefghijkl")


@pytest.fixture
def many_rooms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A store whose rooms are stripes of its floor."""
    left, right = tiny.ROOMS[0], tiny.ROOMS[-1]
    ends = np.linspace(left.x0, right.x1, len(ROOMS) + 1).tolist()
    stripes = [
        Room(name, place, ends[place], left.y0, ends[place + 1], left.y1)
        for place, name in enumerate(ROOMS)
    ]
    monkeypatch.setattr(tiny, "ROOMS", stripes)
    return tiny.build(tmp_path / "rooms.s2r")


async def test_keys_choose_rows_of_the_comparison_and_enter_selects_them(many_rooms):
    async with running(many_rooms, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "c", "9")
        run, names = app.session.state.run, COMPARE.row_names(app.updater.scene)
        assert len(names) == len(ROOMS) + 1  # all instances are a row
        for key, row in (
            ("down", 1), ("down", 2), ("up", 1), ("pagedown", 11), ("end", 12), ("up", 11),
            ("home", 0), ("pageup", 0), ("up", 12), ("down", 0),
        ):  # fmt: skip
            await press(app, pilot, key)
            assert app.session.state.chosen_row("compare") == names[row], key
        assert app.session.state.run == run
        assert ("up, down", "rows") in footer(80, app.session.state)
        await press(app, pilot, "end", "enter")
        assert app.session.state.expression == f'room:"{names[-1]}"'
        assert app.session.state.selected.any()


async def test_the_mouse_wheel_moves_through_the_rooms(many_rooms):
    async with running(many_rooms, size=(80, 12)) as (app, pilot):
        await press(app, pilot, "c", "6")
        plot, names = app.updater.plot("rooms"), VIEW.row_names(app.updater.scene)
        before = VIEW.chosen_row(app.updater.scene)
        for event, steps in ((MouseScrollDown, 1), (MouseScrollDown, 2), (MouseScrollUp, 1)):
            turn = event(plot, 5, 5, 0, 0, 0, False, False, False, 5, 5)
            plot.post_message(turn.stop())
            await settle(app, pilot)
            assert app.session.state.chosen_row("rooms") == names[min(before + steps, 11)]
            assert names[before + steps] in take_screenshot(app).text


async def test_the_room_of_the_cursor_is_shown(many_rooms):
    async with running(many_rooms, size=(80, 12)) as (app, pilot):
        await press(app, pilot, "c", "6")
        table = VIEW.drawing(app.updater.scene, 80).table
        last, names = table.rows[-1].cells[0].text, app.session.store.instances.room_names
        assert last not in take_screenshot(app).text
        members = app.session.store.instances.room == names.index(last)
        app.session.dispatch(navigation.set_cursor, int(members.argmax()))
        app.updater.refresh()
        await settle(app, pilot)
        assert last in take_screenshot(app).text


@pytest.mark.parametrize(("view", "row", "expression"), [
    ("recall", "recall 2 m, 20 deg", "real.error <= 2 & real.heading_error <= 20"),
    ("recall", "skill", ""),
    ("risk", "radius all rooms", "all"),
    ("shares", "lighting", "share.lighting > 0"),
    ("exchange", "vanilla", "paired & new"),
    ("exchange", "dataaug", 'run("dataaug").paired & run("dataaug").new'),
])  # fmt: skip
async def test_a_row_of_numbers_selects_the_instances_that_it_stands_for(
    tiny_store, view, row, expression
):
    shown = BY_NAME[view]
    async with running(tiny_store, size=(80, 40)) as (app, pilot):
        await press(app, pilot, "c", key_name(shown.key))
        number = list(shown.row_names(app.updater.scene)).index(row)
        await press(app, pilot, *["down"] * number, "enter")
        state = app.session.state
        assert (state.chosen_row(view), state.is_error) == (row, False)
        if expression:
            assert state.expression == expression
            assert state.message == f"selected {expression}: {state.count_text}"
        else:
            assert f"{row} stands for no instances" in state.message
            assert state.expression == "all"
