"""Large runs load in a background worker: keys stay responsive and the newest request wins."""

import gc
import threading
import weakref
from collections.abc import AsyncIterator, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from textual.pilot import Pilot

import s2rstore
from s2rstore.index import column_loader
from s2rstore.language.syntax_tree import Everything
from s2rtools.precompute.run_registration import add_run
from s2rtui.app import pilot as headless
from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.canvas.marks import BrushShape
from s2rtui.session import targets
from s2rtui.session.session import Session
from s2rtui.session.state import Brush, State, Target
from tests.support import tiny
from tests.support.application import make_app, running

RUNS = ("vanilla", "b", "c")
DelayedReads = tuple[S2RApp, Pilot[None], threading.Event]
"""An application, its pilot, and the event that lets its worker read."""


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.build(tmp_path_factory.mktemp("three") / "s.s2r", runs=RUNS)


@pytest.fixture(scope="module")
def four_runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.build(tmp_path_factory.mktemp("four") / "s.s2r", runs=(*RUNS, "d"))


@pytest.fixture
def gate(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """Treat every store as large, and block reads in background threads while the event is clear.

    It is set at first, so that the application starts.
    """
    released, ui_thread = threading.Event(), threading.current_thread()
    predicted = column_loader._predicted

    def blocking_read(index, run, side, name):
        if run != "vanilla":
            assert threading.current_thread() is not ui_thread, f"{run} {side} {name} is read here"
            assert released.wait(20)
        return predicted(index, run, side, name)

    monkeypatch.setattr(targets, "SMALL_STORE", 0)
    monkeypatch.setattr(column_loader, "_predicted", blocking_read)
    released.set()
    yield released
    released.set()


async def press(app: S2RApp, pilot: Pilot[None], *keys: str) -> None:
    for key in keys:
        await pilot.press(key)
        await pilot.pause()


def add_later_run(store: Path) -> None:
    """Publish a newer generation."""
    add_run(store, "later", "vanilla", None, None, {"sim": [], "real": []})


async def test_keys_are_handled_while_a_run_loads(store, gate):
    async with running(store, size=(80, 24)) as (app, pilot):
        gate.clear()
        await press(app, pilot, "c", "r")
        assert app.session.state.run == "vanilla"
        assert "run vanilla (loading b)" in take_screenshot(app).text
        await press(app, pilot, "w", "n", "m")
        state = app.session.state
        assert (state.run, state.expression, state.map_mode) == ("vanilla", "worst15", "glyph")
        gate.set()
        await settle(app, pilot)
        state = app.session.state
        assert (state.run, state.pending, state.expression) == ("b", None, "worst15")
        errors = app.session.store.run_columns("b").real.error
        assert set(np.flatnonzero(state.selected)) == set(np.argsort(-errors, kind="stable")[:6])
        assert "loading" not in take_screenshot(app).text.splitlines()[0]


@pytest.fixture
async def delayed_losses(
    store: Path, monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[DelayedReads]:
    """An application with an undone expression on the loss column, whose reads are blocked."""
    monkeypatch.setattr(targets, "SMALL_STORE", 0)
    predicted, ui_thread = column_loader._predicted, threading.current_thread()
    released = threading.Event()

    def blocking_read(index, run, side, name):
        assert threading.current_thread() is not ui_thread, f"{name} is read here"
        assert released.wait(20)
        return predicted(index, run, side, name)

    async with running(store, size=(80, 24)) as (app, pilot):
        app.session.select("real.loss > 0")
        app.session.select("all")
        app.session.store._columns.drop(lambda key: "loss" in key)
        app.session.store.selection_cache.clear()
        monkeypatch.setattr(column_loader, "_predicted", blocking_read)
        yield app, pilot, released
        released.set()


async def test_a_pending_selection_consumes_its_operator_and_keeps_a_later_brush(delayed_losses):
    app, pilot, release = delayed_losses
    app.session.select("straight")
    with_brush_and_operator(app.session)
    app.session.select("real.loss > 0")
    app.updater.refresh()
    assert (app.session.state.brush, app.session.state.operator) == (None, "replace")
    brush, _ = with_brush_and_operator(app.session)
    release.set()
    await settle(app, pilot)
    state = app.session.state
    assert (state.expression, state.pending) == ("straight | real.loss > 0", None)
    assert (state.brush, state.operator) == (brush, "union")


async def test_the_compared_run_is_read_in_the_background(store, gate):
    async with running(store, size=(80, 24)) as (app, pilot):
        gate.clear()
        await press(app, pilot, "9")
        assert "loading run b" in take_screenshot(app).text
        gate.set()
        await settle(app, pilot)
        assert "loading" not in take_screenshot(app).text
        assert "b better" in take_screenshot(app).text or "▲" in take_screenshot(app).text


async def test_an_unreadable_run_shows_an_error(store, gate, monkeypatch):
    async with running(store, size=(80, 24)) as (app, pilot):

        def failing_read(*_: object) -> None:
            raise s2rstore.errors.RequestError("the index cannot be read")

        monkeypatch.setattr(targets, "load_columns", failing_read)
        app.session.store._columns.drop(lambda key: key[0] == "run" and key[1] == "c")
        await press(app, pilot, "R")
        await settle(app, pilot)
        state = app.session.state
        assert (state.run, state.pending) == ("vanilla", None)
        assert (state.message, state.is_error) == ("the index cannot be read", True)


@pytest.mark.parametrize("is_error", [False, True])
def test_a_newer_message_is_kept_when_a_run_arrives(store, is_error):
    session = Session(store)
    with_brush_and_operator(session, pending=Target("b", session.state.generation))
    session.show_message("wrote rows.csv", is_error)
    state = session.complete_pending()
    assert (state.run, state.message, state.is_error) == ("b", "wrote rows.csv", is_error)
    assert session.set_cursor(1).message == ""
    session.close()


def test_a_message_about_the_selection_is_cleared_when_a_run_arrives(store):
    session = Session(store)
    session.select("none")
    pending = Target("b", session.state.generation, node=Everything())
    with_brush_and_operator(session, pending=pending)
    assert session.state.message == "nothing is selected"
    assert session.complete_pending().message == ""
    session.close()


async def test_the_announced_key_selects_the_saved_run(four_runs):
    async with running(four_runs, size=(80, 24)) as (app, pilot):
        runs = app.session.state.runs
        for present, saved in ((0, 0), (0, 1), (0, 2), (0, 3), (3, 0), (3, 1), (2, 1)):
            app.session.set_run(runs[present])
            app.adjust.open_saved(runs[saved])
            await settle(app, pilot)
            message = app.session.state.message
            assert message.startswith(f"run {runs[saved]} is saved")
            if ": " not in message:
                assert present == saved
            elif "click" in message:
                assert (saved - present) % 4 == 2
            else:
                await press(app, pilot, message.split(": ")[1][0])
                assert app.session.state.run == runs[saved]


def test_a_newer_generation_keeps_a_pending_selection(store_copy, monkeypatch):
    monkeypatch.setattr(targets, "SMALL_STORE", 0)
    session = Session(store_copy)
    session.defers_loading = True
    session.select("real.loss > 0")
    brush, _ = with_brush_and_operator(session)
    add_later_run(store_copy)
    session.open_newest_generation()
    assert session.state.message.endswith(f"of generation {session.store.latest_generation()}")
    state = session.complete_pending(s2rstore.open(store_copy))
    assert (state.generation, state.expression) == (session.store.generation, "real.loss > 0")
    assert (state.generation, state.brush) == (state.newest, brush)
    session.close()


async def test_an_old_store_is_closed_after_its_last_reader(store_copy):
    app, entered, release = make_app(store_copy), threading.Event(), threading.Event()
    async with app.run_test(size=(80, 24)) as pilot:
        await settle(app, pilot)
        before = app.session.store
        add_later_run(store_copy)
        app.load_scheduler._workers["lines"].put(lambda: (entered.set(), release.wait(20)))
        assert entered.wait(10)
        await press(app, pilot, "g")
        app.store_updates.check_store()
        assert app.session.store is not before
        assert before.execute("SELECT 1") == [(1,)]
        release.set()
        await settle(app, pilot)
        while not app.load_scheduler.idle:
            await pilot.pause()
        app.store_updates.check_store()
        with pytest.raises(s2rstore.errors.RequestError, match="is closed"):
            before.execute("SELECT 1")
        assert not before._columns.nbytes


async def test_no_reference_to_an_old_store_remains(store_copy):
    """Neither workers nor their timers nor hidden views refer to it."""
    async with running(store_copy, size=(80, 24)) as (app, pilot):
        for key in "123456":
            await press(app, pilot, key)
            await settle(app, pilot)
        before = weakref.ref(app.session.store)
        add_later_run(store_copy)
        await press(app, pilot, "g")
        await settle(app, pilot)
        while not app.load_scheduler.idle:
            await pilot.pause()
        app.store_updates.check_store()
        await pilot.pause()
        gc.collect()
        assert before() is None


def with_brush_and_operator(session: Session, **fields: object) -> tuple[Brush, State]:
    """Add a brush and an operator to the session's state."""
    brush = Brush("map", BrushShape("map", ((1.0, 1.0), (3.0, 2.0))))
    state = replace(session.state, brush=brush, operator="union", **fields)
    return brush, session.set_state(state)


def test_a_pending_run_may_be_missing_from_the_newer_generation(store_copy):
    session = Session(store_copy, "vanilla")
    with_brush_and_operator(session, pending=Target("vanilla", session.state.generation + 1))
    add_later_run(store_copy)
    newer = s2rstore.open(store_copy)
    del newer.runs["vanilla"]
    state = session.complete_pending(newer)
    assert session.store is newer
    assert (state.run, state.pending, state.brush) == ("dataaug", None, None)
    session.close()


def test_a_failed_change_of_generation_changes_nothing(store_copy, monkeypatch):
    session = Session(store_copy)
    add_later_run(store_copy)
    store, state, newer = session.store, session.state, s2rstore.open(store_copy)
    monkeypatch.setattr(type(newer), "array_kinds", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        session.complete_pending(newer)
    assert (session.store, session.state) == (store, state)
    assert store.execute("SELECT 1") == [(1,)]
    with pytest.raises(s2rstore.errors.RequestError, match="is closed"):
        newer.execute("SELECT 1")
    session.close()


def test_columns_of_a_run_in_use_are_not_dropped(store):
    with s2rstore.open(store) as opened:
        opened.in_use = frozenset({"vanilla"})
        columns = {run: opened.run_columns(run).real.error for run in ("vanilla", "b")}
        for run in columns:
            opened.drop_run_columns(run)
        assert opened.run_columns("vanilla").real.error is columns["vanilla"]
        assert opened.run_columns("b").real.error is not columns["b"]


def test_a_store_can_be_opened_at_an_earlier_generation(store_copy):
    with s2rstore.open(store_copy) as before:
        add_later_run(store_copy)
        with s2rstore.open(store_copy, generation=before.generation) as again:
            assert again.generation == before.generation
            assert "later" not in again.runs
    with s2rstore.open(store_copy) as newest:
        assert "later" in newest.runs
    with pytest.raises(s2rstore.errors.RequestError, match="missing"):
        s2rstore.open(store_copy, generation=999)


def test_the_screen_of_a_state_uses_its_history(store, tmp_path, monkeypatch):
    nights = tmp_path / "nights.duckdb"
    nights.touch()
    session = Session(store, gap_history=nights)
    opened: list[Session] = []
    monkeypatch.setattr(headless, "S2RApp", lambda shown, _: opened.append(shown) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        headless.snapshot(store, (80, 24), state=session.state)
    assert opened[0].state is session.state
    assert opened[0].store.in_use == {session.state.run}
    assert not opened[0].apply_updates(opened[0].read_updates())
    for one in (session, *opened):
        one.close()
