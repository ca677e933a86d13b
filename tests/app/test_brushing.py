"""Brushing by keys and mouse, operators, saved selections, notes and tags in the application."""

from dataclasses import replace

import numpy as np
import pytest
from textual.events import MouseScrollDown
from textual.pilot import Pilot

from s2rstore.errors import RequestError
from s2rtui.app.app import S2RApp
from s2rtui.app.controllers import annotations
from s2rtui.app.key_bindings import ACTIONS
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.app.screens.tour import TourScreen
from s2rtui.canvas.marks import PlotArea
from s2rtui.charts.errors import errors_model
from s2rtui.charts.registry import BY_NAME, VIEWS
from s2rtui.session import instance_list
from s2rtui.session.session import Session
from s2rtui.user_data.notebook import Notebook
from tests.support.application import make_app, press, running

BRUSHABLE = (
    "overview", "map", "umap", "orientation", "rooms", "errors", "scatter", "list", "compare",
)  # fmt: skip
KEYS = {view.name: view.key for view in VIEWS}


def panels(app: S2RApp, name: str) -> list[PlotArea]:
    return list(app.brush.panels(BY_NAME[name]))


def brush_is_drawn(app: S2RApp, name: str) -> bool:
    """Whether a view looks different without its brush, and its cache tells so."""
    view, scene = BY_NAME[name], app.updater.scene
    without = replace(scene, state=replace(scene.state, brush=None))
    size, options = app.updater.plot(name).size, app.render_options
    one, other = (view.draw(each, size, options) for each in (scene, without))
    looks_alike = np.array_equal(one.char, other.char) and np.array_equal(one.bg, other.bg)
    return not looks_alike and view.cache_key(scene) != view.cache_key(without)


@pytest.mark.parametrize("size", [(80, 24), pytest.param((200, 60), marks=pytest.mark.deep)])
async def test_every_view_can_be_brushed_by_keys(tiny_store, size):
    app, other = make_app(tiny_store), Session(tiny_store)
    async with app.run_test(size=size) as pilot:
        for name in BRUSHABLE:
            await press(app, pilot, "c", KEYS[name], "x")
            brush = app.session.state.brush
            assert brush is not None, name
            assert brush.view == name
            await press(app, pilot, "Z", "right", "down", "shift+down", "shift+right")
            assert brush_is_drawn(app, name), name
            await press(app, pilot, "enter")
            state = app.session.state
            assert state.brush is None, name
            assert not state.is_error, name
            assert state.expression != "all", name
            assert np.array_equal(other.select(state.expression).selected, state.selected), name
    other.close()


async def test_escape_drops_a_brush_and_a_pending_operator(tiny_store):
    async with running(tiny_store) as (app, pilot):
        await press(app, pilot, "w")
        assert "escape cancel" not in take_screenshot(app).text
        await press(app, pilot, "x")
        assert "escape cancel" in take_screenshot(app).text
        await press(app, pilot, "escape")
        assert app.session.state.brush is None
        await press(app, pilot, "vertical_line")
        text = take_screenshot(app).text
        assert "| _" in text
        assert "escape cancel" in text
        await press(app, pilot, "escape")
        assert app.session.state.operator == "replace"
        assert app.session.state.expression == "worst15"
        assert "escape cancel" not in take_screenshot(app).text


async def drag(app: S2RApp, pilot: Pilot[None], name: str, cells: list[tuple[int, int]]) -> None:
    view = f"#{name}"
    await pilot.mouse_down(view, offset=cells[0])
    for cell in cells[1:]:
        await pilot.hover(view, offset=cell)
    await pilot.mouse_up(view, offset=cells[-1])
    await settle(app, pilot)


async def test_up_recalls_the_history(tiny_store):
    async with running(tiny_store) as (app, pilot):
        await press(app, pilot, "w", "b", "slash", "up", "up")
        assert app.query_line.value == "worst15"
        await press(app, pilot, "enter")
        assert app.session.state.expression == "worst15"


async def test_an_empty_selection_suggests_one_that_is_not_empty(tiny_store):
    async with running(tiny_store) as (app, pilot):
        await press(app, pilot, "slash")
        app.query_line.value = "worst(1, sim.error) & best(1, sim.error)"
        await press(app, pilot, "enter")
        assert "would give 1 (key Y)" in take_screenshot(app).text.splitlines()[-2]
        suggested = app.session.state.suggested
        await press(app, pilot, "Y")
        state = app.session.state
        assert (state.node, state.selected.sum()) == (suggested, 1)
        assert state.suggested is None
        await press(app, pilot, "u")
        assert app.session.state.count_text.startswith("0 of")
        await press(app, pilot, "c", "Y")
        assert "there is no suggestion" in app.session.state.message


async def test_the_scatter_view_is_clicked_and_selects_by_a_lasso(tiny_store):
    async with running(tiny_store) as (app, pilot):
        await press(app, pilot, "c", "X")
        columns = app.session.store.run_columns(app.session.state.run)
        iid = int(np.argmax(columns.sim.error))
        panel = panels(app, "scatter")[0]
        place = panel.to_cells(float(columns.sim.error[iid]), float(columns.real.error[iid]))
        await pilot.click("#scatter", offset=(int(place[0]), int(place[1]) + 1))
        await press(app, pilot, "L")
        assert app.session.state.cursor == iid
        left, top = panel.x, panel.y + 1
        right, bottom = left + panel.width - 2, top + panel.height - 2
        await drag(app, pilot, "scatter", [(left, top), (right, top), (right, bottom),
                                           (left, bottom)])  # fmt: skip
        assert app.session.state.expression.startswith("error.lasso(")
        assert app.session.state.selected.sum() > 0


async def test_tab_cycles_through_views_and_panels(tiny_store):
    async with running(tiny_store, size=(200, 60)) as (app, pilot):
        await press(app, pilot, "1")
        visited, names = [], [view.name for view in VIEWS if view.name != "adjust"]
        for _ in names:
            await press(app, pilot, "tab")
            visited.append(app.session.state.view)
        assert sorted(visited) == sorted(names)
        await press(app, pilot, "shift+tab")
        assert app.session.state.view == visited[-2]
        await press(app, pilot, "5", "x")
        brushed = set()
        for _ in range(3):
            brush = app.session.state.brush
            brushed.add(brush.mark.panel)
            await press(app, pilot, "tab")
        assert brushed == {"sim", "truth", "real"}


async def test_changing_a_tag_updates_the_selection_that_uses_it(tiny_store):
    async with running(tiny_store) as (app, pilot):
        await press(app, pilot, "w", "number_sign", *"done", "enter", "slash")
        app.query_line.value = "worst15 - @done"
        await press(app, pilot, "enter")
        assert app.session.state.count_text == "5 of 40"
        await press(app, pilot, "number_sign", *"done", "enter")
        assert app.session.state.count_text == "4 of 40"
        await press(app, pilot, "w", "number_sign", *"one", "enter")
        app.session.select("@one")
        await press(app, pilot, "number_sign", *"one", "enter")
        assert app.session.state.is_error
        assert "the selection is unchanged" in app.session.state.message
        assert not app.prompt.is_open


@pytest.mark.parametrize("name", ["map", "orientation", "errors"])
async def test_an_interrupted_drag_leaves_no_mark(tiny_store, name):
    app, size = make_app(tiny_store), (120, 40)
    async with app.run_test(size=size) as pilot:
        for interruption in ("escape", "resize", "tiny", "view"):
            await pilot.resize_terminal(*size)
            await press(app, pilot, "c", KEYS[name])
            panel = panels(app, name)[-1]
            start = panel.x + panel.width // 4, panel.y + panel.height // 4 + 1
            next_cell = panel.x + panel.width // 2, panel.y + panel.height // 2 + 1
            await pilot.mouse_down(f"#{name}", offset=start)
            await pilot.hover(f"#{name}", offset=next_cell)
            await settle(app, pilot)
            assert app.session.state.brush is not None, interruption
            if interruption == "escape":
                await press(app, pilot, "escape")
            elif interruption == "view":
                await pilot.resize_terminal(80, 24)
                await pilot.mouse_down(f"#{name}", offset=(20, 9))
                await pilot.hover(f"#{name}", offset=(25, 11))
                await press(app, pilot, "1")
            else:
                await pilot.resize_terminal(*((80, 24) if interruption == "resize" else (20, 6)))
                await settle(app, pilot)
            assert app.session.state.brush is None, interruption
            assert app.mouse_captured is None, interruption
            await pilot.hover(None, offset=(9, 4))
            await pilot.mouse_up(None, offset=(12, 4))
            await settle(app, pilot)
            assert app.session.state.brush is None, interruption
            assert app.session.state.expression == "all", interruption
        await press(app, pilot, "c", KEYS[name])
        await pilot.mouse_down(f"#{name}", offset=(20, 9))
        await press(app, pilot, "escape")  # a drag that has not moved
        await pilot.hover(f"#{name}", offset=(30, 15))
        await pilot.mouse_up(f"#{name}", offset=(30, 15))
        await settle(app, pilot)
        assert app.session.state.expression == "all"


async def test_the_key_that_closes_the_tour_has_no_other_effect(tiny_store):
    app = make_app(tiny_store)
    app.is_first_start = True
    async with app.run_test(size=(80, 24)) as pilot:
        await settle(app, pilot)
        before = app.session.state
        for key in (action.keys[-1] for action in ACTIONS[::4]):
            assert isinstance(app.screen, TourScreen)
            await pilot.press(key)
            assert app.screen is app.default_screen
            assert app.session.state is before
            assert not app.prompt.is_open
            app.action_tour()
            await pilot.pause()


async def test_the_history_is_saved_last_and_may_fail(tiny_store, monkeypatch):
    app, calls = make_app(tiny_store), []

    def failing_save(*_: object) -> None:
        calls.append("remembered")
        raise OSError("no locks available")

    stop = app.load_scheduler.stop
    monkeypatch.setattr(app.load_scheduler, "stop", lambda: (calls.append("stopped"), stop()))
    monkeypatch.setattr(app.computation, "close", lambda: calls.append("left"))
    monkeypatch.setattr(Notebook, "add_history", failing_save)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
    assert calls == ["stopped", "left", "remembered"]
    assert app.fault is None


async def test_an_unreachable_store_is_reported_once(tiny_store, monkeypatch):
    def unreachable() -> bool:
        raise RequestError("the store is out of reach")

    async with running(tiny_store) as (app, _pilot):
        with monkeypatch.context() as patch:
            patch.setattr(app.session, "read_updates", unreachable)
            app.store_updates.check_store()
            assert app.session.state.message == "the store is out of reach"
            app.session.show_message("what the user does now")
            app.store_updates.check_store()
            assert app.session.state.message == "what the user does now"
            app.session.show_message("the store is out of reach", is_error=True)
        app.store_updates.check_store()
        assert (app.session.state.message, app.session.state.is_error) == ("", False)


async def test_a_lasso_needs_three_corners_and_is_simplified(tiny_store):
    async with running(tiny_store) as (app, pilot):
        await press(app, pilot, "c", "L", "x", "enter")
        assert "three corners" in app.session.state.message
        assert app.session.state.expression == "all"
        await press(app, pilot, "escape", "x", "ampersand")
        state = app.session.state
        assert "three corners" in state.message
        assert (state.operator, state.brush is None) == ("replace", False)
        await press(app, pilot, "escape")
        panel = panels(app, "map")[0]
        start = panel.x + 9, panel.y + 9
        await drag(app, pilot, "map", [start, (start[0] + 1, start[1])])
        assert "three corners" in app.session.state.message
        assert app.session.state.brush is None
        await press(app, pilot, "x", "space")
        for key in ("right", "down", "left"):
            await pilot.press(*[key] * 8)
            await press(app, pilot, "space")
        await press(app, pilot, "enter")
        assert app.session.state.expression.startswith("lasso(")
        assert not app.session.state.is_error
        await press(app, pilot, "c", "2")
        turn = np.linspace(0, 2 * np.pi, 50)
        column = panel.x + panel.width / 2 + panel.width / 2.3 * np.cos(turn)
        row = panel.y + 1 + panel.height / 2 + panel.height / 2.3 * np.sin(turn)
        cells = [(int(c), int(r)) for c, r in zip(column, row, strict=True)]
        await drag(app, pilot, "map", cells)
        assert not app.session.state.is_error, app.session.state.message
        assert app.session.state.expression.startswith("lasso(")
        assert app.session.state.selected.any()


async def test_views_are_brushed_and_clicked_by_mouse(tiny_store):
    async with running(tiny_store, size=(200, 60)) as (app, pilot):
        for name in ("umap", "rooms", "orientation"):
            await press(app, pilot, "c", KEYS[name])
            panel = panels(app, name)[-1]
            first = panel.x + panel.width // 4, panel.y + panel.height // 4 + 1
            last = panel.x + panel.width * 3 // 4, panel.y + panel.height * 3 // 4 + 1
            await drag(app, pilot, name, [first, last])
            state = app.session.state
            assert not state.is_error, name
            assert state.expression != "all", name
            assert state.brush is None, name

        await press(app, pilot, "c", "7")
        columns = BY_NAME["errors"].input(app.updater.scene)
        panel = next(p for p in panels(app, "errors") if p.name == "real")
        counts = errors_model(*columns, panel.width).sides["real"].whole
        await drag(app, pilot, "errors", [(panel.x + 3, panel.y + 2), (panel.x + 20, panel.y + 2)])
        assert abs(int(app.session.state.selected.sum()) - int(counts[3:21].sum())) <= 1

        await press(app, pilot, "c", "2")
        panel, truth = panels(app, "map")[0], app.session.store.instances
        column, row = panel.to_cells(float(truth.x[17]), float(truth.y[17]))
        await pilot.click("#map", offset=(int(column), int(row) + 1))
        await settle(app, pilot)
        cursor = app.session.state.cursor
        assert cursor is not None
        assert np.hypot(truth.x[cursor] - truth.x[17], truth.y[cursor] - truth.y[17]) < 0.5
        (left, top), (right, bottom) = cells = [(panel.x + 5, panel.y + 6),
                                                (panel.x + 30, panel.y + 30)]  # fmt: skip
        await drag(app, pilot, "map", cells)
        places = [panel.to_cells(float(x), float(y)) for x, y in zip(truth.x, truth.y, strict=True)]
        inside = [left <= column < right + 1 and top - 1 <= row < bottom for column, row in places]
        assert np.array_equal(app.session.state.selected, inside)
        assert any(inside)

        await press(app, pilot, "c", "1")
        panel = next(p for p in panels(app, "overview") if p.name == "dataaug")
        y = panel.y + 1
        await drag(app, pilot, "overview", [(panel.x + 2, y), (panel.x + panel.width - 2, y)])
        assert not app.session.state.is_error, app.session.state.message
        assert 'run("dataaug").real.accuracy:' in app.session.state.expression
        await pilot.click("#overview", offset=(panel.x + 3, y))
        await settle(app, pilot)
        assert app.session.state.run == "dataaug"

        await press(app, pilot, "c", "8")  # the wheel moves the cursor of a list without the focus
        rows = instance_list.order(app.session.store, app.session.state, app.session.notes)
        app.session.set_cursor(int(rows[4]))
        await press(app, pilot, "1")
        await pilot._post_mouse_events([MouseScrollDown], "#list", offset=(9, 9), button=0)
        await settle(app, pilot)
        assert (app.session.state.cursor, app.session.state.run) == (rows[5], "dataaug")


async def test_notes_tags_and_selections_are_written_and_shown(tiny_store):
    app, other = make_app(tiny_store), Session(tiny_store, notebooks=Notebook)
    async with app.run_test(size=(200, 60)) as pilot:
        await press(app, pilot, "w", "number_sign", *"door", "enter", "e", *"glass", "enter", "8")
        assert "#door: glass" in take_screenshot(app).text
        other.writable_notebook.toggle_tag([2, 3], "theirs")
        for tag, count in (("@door", "1 of 40"), ("@theirs", "2 of 40")):
            await press(app, pilot, "slash")
            app.query_line.value = tag
            await press(app, pilot, "enter")
            assert app.session.state.count_text == count
        await press(app, pilot, "w", "at", "space", "enter")
        assert app.prompt.is_open  # a name of blanks is refused
        assert app.session.state.is_error
        await press(app, pilot, "escape")
        assert not app.prompt.is_open
        await press(app, pilot, "at", *"bad", "enter", "c", "f")
        assert "@bad" in take_screenshot(app).text
        await press(app, pilot, "enter")
        assert app.session.state.expression == "worst15"
        await press(app, pilot, "f", "d", "escape")
        assert "bad" not in app.session.notes.selections
    other.close()


async def test_notes_and_tags_need_instances_and_not_too_many(tiny_store, monkeypatch):
    async with running(tiny_store) as (app, pilot):
        cursor = app.session.state.cursor
        app.session.set_state(replace(app.session.state, cursor=None))
        for key, what in (("e", "note"), ("number_sign", "tag")):
            await press(app, pilot, key)
            assert app.session.state.message == f"no instance for a {what}: select some"
        assert not app.prompt.is_open
        app.session.set_state(replace(app.session.state, cursor=cursor))
        await press(app, pilot, "c", "number_sign", *"many*")
        monkeypatch.setattr(annotations, "_MAX_TAGGED", 39)
        await press(app, pilot, "enter")
        assert "40 instances are too many to tag (at most 39): @" in app.session.state.message
        monkeypatch.setattr(annotations, "_MAX_TAGGED", 40)
        await press(app, pilot, "enter")
        assert app.session.state.message == "tagged: 40 instances"
        app.session.select("none")
        await press(app, pilot, "number_sign", *"few*", "enter")
        assert "nothing is selected" in app.session.state.message
        assert app.prompt.is_open
    assert {tag for r in app.session.notes.remarks.values() for tag in r.tags} == {"many"}
