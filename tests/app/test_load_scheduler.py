"""Runs of large stores are read by a worker: keys go on, the newest wins, the screen says which."""

from __future__ import annotations

import gc
import threading
import weakref
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from textual.pilot import Pilot

import s2rstore
from s2rstore.index import column_loader
from s2rstore.lru_cache import LruCache
from s2rtools.precompute.registration import add_run
from s2rtui.app import pilot as headless
from s2rtui.app.app import S2RApp
from s2rtui.app.messages import RunSaveProgressed
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.canvas import RenderOptions
from s2rtui.canvas.marks import Mark
from s2rtui.jobs.precompute_job import JobProgress
from s2rtui.loaders import store_data
from s2rtui.session import Brush, Session, State, navigation, pending_target, shared_selection
from s2rtui.session.state import PendingTarget
from tests.support import tiny

RUNS = ("vanilla", "b", "c")


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.build(tmp_path_factory.mktemp("three") / "s.s2r", runs=RUNS)


@pytest.fixture(scope="module")
def four_runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.build(tmp_path_factory.mktemp("four") / "s.s2r", runs=(*RUNS, "d"))


@pytest.fixture
def gate(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """Everything is large, and columns of other threads than this come once it is open."""
    opened, here = threading.Event(), threading.current_thread()
    whole = column_loader._predicted

    def slow(index, run, side, name, lacking):
        if run != "vanilla":
            assert threading.current_thread() is not here, f"{run} {side} {name} is read here"
            assert opened.wait(20)
        return whole(index, run, side, name, lacking)

    monkeypatch.setattr(pending_target, "SMALL_STORE", 0)
    monkeypatch.setattr(column_loader, "_predicted", slow)
    yield opened
    opened.set()


@dataclass
class Lossy:
    """An application, and what lets its worker read."""

    app: S2RApp
    pilot: Pilot[None]
    opened: threading.Event


def make_app(path: Path) -> S2RApp:
    app = S2RApp(Session(path), RenderOptions())
    app.load_scheduler.debounce_seconds = 0.001
    return app


async def press(app: S2RApp, pilot: Pilot[None], *keys: str) -> None:
    for key in keys:
        await pilot.press(key)
        await pilot.pause()


async def test_keys_go_on_while_a_run_is_read(store: Path, gate: threading.Event) -> None:
    app = make_app(store)
    async with app.run_test(size=(120, 40)) as pilot:
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
        with s2rstore.open(store) as own:
            worst = own.execute(
                "SELECT iid FROM prediction WHERE run = 'b' AND side = 'real' "
                "ORDER BY error DESC LIMIT 6"
            )
        assert set(np.flatnonzero(state.selected)) == {iid for (iid,) in worst}
        assert "loading" not in take_screenshot(app).text.splitlines()[0]


async def test_a_selection_of_a_run_that_is_not_there_yet_waits_for_it(
    store: Path, gate: threading.Event
) -> None:
    app = make_app(store)
    async with app.run_test(size=(120, 40)) as pilot:
        await press(app, pilot, "c")
        before, own = app.session.state, app.session.store.dataset.hash
        facts = f"data set {own}, generation {before.generation}, run b, 3 instances"
        text = f"worst(3, real.error)  # {facts}"
        app.session.dispatch(shared_selection.select_text, text)
        app.refresh_views()
        await pilot.pause()
        state = app.session.state
        assert (state.run, state.expression, state.message) == ("vanilla", "all", "loading run b")
        gate.set()
        await settle(app, pilot)
        state = app.session.state
        assert (state.run, state.expression, state.pending) == ("b", "worst(3, real.error)", None)
        assert state.past[-1] == "all"
        errors = app.session.store.run_columns("b").real.error
        assert set(np.flatnonzero(state.selected)) == set(np.argsort(-errors, kind="stable")[:3])


async def test_columns_of_an_expression_are_read_elsewhere(
    store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pending_target, "SMALL_STORE", 0)
    whole, here, read = column_loader._predicted, threading.current_thread(), []

    def watched(index, run, side, name, lacking):
        read.append((name, threading.current_thread() is here))
        return whole(index, run, side, name, lacking)

    app = make_app(store)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        for column in ("real.outlier", "sim.outlier"):
            side, _, name = column.partition(".")
            assert app.session.store.has_loaded("vanilla", side, [name])
        assert app.session.store.has_loaded(None, None, ["curvature"])
        monkeypatch.setattr(column_loader, "_predicted", watched)
        await press(app, pilot, "slash", "ctrl+u")
        await press(app, pilot, *["real.loss > 0"[i] for i in range(13)], "enter")
        await settle(app, pilot)
        assert app.session.state.expression == "real.loss > 0"
        assert app.session.state.selected.all()
        assert read == [("loss", False)]


@pytest.fixture
async def lossy(store: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Lossy]:
    """An application whose losses are read anew, once it may, with an expression of them undone."""
    monkeypatch.setattr(pending_target, "SMALL_STORE", 0)
    whole, here, opened = column_loader._predicted, threading.current_thread(), threading.Event()

    def slow(index, run, side, name, lacking):
        assert threading.current_thread() is not here, f"{name} is read here"
        assert opened.wait(20)
        return whole(index, run, side, name, lacking)

    app = make_app(store)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        app.session.select("real.loss > 0")
        app.session.select("all")
        app.session.store._columns.drop(lambda key: "loss" in key)
        app.session.store.evaluated.clear()
        monkeypatch.setattr(column_loader, "_predicted", slow)
        yield Lossy(app, pilot, opened)
        opened.set()


async def test_an_undone_expression_waits_for_its_columns(lossy: Lossy) -> None:
    app, pilot = lossy.app, lossy.pilot
    past = app.session.state.past
    await press(app, pilot, "u")
    assert app.session.state.expression == "all"
    assert "run vanilla (selecting)" in take_screenshot(app).text
    lossy.opened.set()
    await settle(app, pilot)
    state = app.session.state
    assert (state.expression, state.past, state.future) == ("real.loss > 0", past[:-1], ("all",))
    assert state.pending is None
    await press(app, pilot, "U")
    assert (app.session.state.expression, app.session.state.past) == ("all", past)


async def test_an_undo_that_waits_is_taken_back_by_redo(lossy: Lossy) -> None:
    app, pilot = lossy.app, lossy.pilot
    before = app.session.state
    await press(app, pilot, "u", "U")
    assert "(selecting)" not in take_screenshot(app).text
    lossy.opened.set()
    await settle(app, pilot)
    after = app.session.state
    assert (after.expression, after.past, after.future) == ("all", before.past, ())


async def test_every_undo_counts_while_one_waits(lossy: Lossy) -> None:
    app, pilot = lossy.app, lossy.pilot
    past = app.session.state.past
    app.session.set_state(replace(app.session.state, past=(*past, "real.loss > 0.001")))
    await press(app, pilot, "u", "u")
    assert app.session.state.expression == "all"
    lossy.opened.set()
    await settle(app, pilot)
    state = app.session.state
    assert (state.expression, state.past) == ("real.loss > 0", past[:-1])
    assert state.future == ("all", "real.loss > 0.001")


async def test_undo_takes_back_a_selection_that_waits(lossy: Lossy) -> None:
    app, pilot = lossy.app, lossy.pilot
    before = app.session.state
    app.session.select("real.loss > 0.001")
    app.refresh_views()
    await press(app, pilot, "u")
    lossy.opened.set()
    await settle(app, pilot)
    after = app.session.state
    assert (after.expression, after.past, after.pending) == ("all", before.past, None)


async def test_a_selection_that_waits_uses_its_operator_up_and_leaves_a_later_brush(
    lossy: Lossy,
) -> None:
    app, pilot = lossy.app, lossy.pilot
    app.session.select("straight")
    begun(app.session)
    app.session.select("real.loss > 0")
    app.refresh_views()
    assert (app.session.state.brush, app.session.state.operator) == (None, "replace")
    brush, _ = begun(app.session)
    lossy.opened.set()
    await settle(app, pilot)
    state = app.session.state
    assert (state.expression, state.pending) == ("straight | real.loss > 0", None)
    assert (state.brush, state.operator) == (brush, "union")


async def test_other_trajectories_leave_a_selection_waiting(lossy: Lossy) -> None:
    app, pilot = lossy.app, lossy.pilot
    app.session.select("real.loss > 0")
    app.refresh_views()
    await press(app, pilot, "t")
    assert app.session.state.trajectories is not None
    lossy.opened.set()
    await settle(app, pilot)
    assert app.session.state.expression == "real.loss > 0"


async def test_what_is_selected_meanwhile_wins(lossy: Lossy) -> None:
    app, pilot = lossy.app, lossy.pilot
    await press(app, pilot, "u", "w")
    assert (app.session.state.expression, app.session.state.pending) == ("worst15", None)
    lossy.opened.set()
    await settle(app, pilot)
    assert app.session.state.expression == "worst15"


def test_what_is_selected_while_a_run_is_awaited_is_taken_along(
    store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pending_target, "SMALL_STORE", 0)
    session = Session(store)
    session.set_state(replace(session.state, pending=PendingTarget("b", 1, "gap > 0")))
    session.select("straight")
    awaited = session.state.pending
    assert awaited is not None
    assert (awaited.run, awaited.text) == ("b", "")
    assert (session.complete_pending().run, session.state.expression) == ("b", "straight")


def test_a_selection_that_has_to_wait_leaves_the_run_awaited(
    store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pending_target, "SMALL_STORE", 0)
    session = Session(store)
    session.defers_loading = True
    session.set_state(replace(session.state, pending=PendingTarget("b", 1)))
    for select in (session.select, partial(session.dispatch, shared_selection.select_text)):
        select("real.loss > 0")
        awaited = session.state.pending
        assert awaited is not None
        assert (awaited.run, awaited.text) == ("b", "real.loss > 0")
    assert (session.complete_pending().run, session.state.expression) == ("b", "real.loss > 0")
    session.close()


async def test_the_newest_run_wins(store: Path, gate: threading.Event) -> None:
    app = make_app(store)
    async with app.run_test(size=(120, 40)) as pilot:
        await press(app, pilot, "r", "r")
        assert "(loading c)" in take_screenshot(app).text
        gate.set()
        await settle(app, pilot)
        assert app.session.state.run == "c"


async def test_back_before_it_came(store: Path, gate: threading.Event) -> None:
    app = make_app(store)
    async with app.run_test(size=(120, 40)) as pilot:
        await press(app, pilot, "r", "R")
        assert app.session.state.pending is None
        gate.set()
        await settle(app, pilot)
        assert app.session.state.run == "vanilla"


async def test_the_other_run_is_read_elsewhere(store: Path, gate: threading.Event) -> None:
    app = make_app(store)
    async with app.run_test(size=(120, 40)) as pilot:
        await press(app, pilot, "9")
        assert "loading run b" in take_screenshot(app).text
        gate.set()
        await settle(app, pilot)
        assert "loading" not in take_screenshot(app).text
        assert "b better" in take_screenshot(app).text or "▲" in take_screenshot(app).text


async def test_a_run_that_cannot_be_read_is_told(
    store: Path, gate: threading.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate.set()
    app = make_app(store)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)

        def broken(*_: object) -> None:
            raise s2rstore.errors.RequestError("the index cannot be read")

        monkeypatch.setattr(pending_target, "load_columns", broken)
        app.session.store._columns.drop(lambda key: key[0] == "run" and key[1] == "c")
        await press(app, pilot, "R")
        await settle(app, pilot)
        state = app.session.state
        assert (state.run, state.pending) == ("vanilla", None)
        assert (state.message, state.is_error) == ("the index cannot be read", True)


async def test_a_run_that_cannot_be_turned_to_is_told(
    store: Path, gate: threading.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    app = make_app(store)
    async with app.run_test(size=(120, 40)) as pilot:
        await press(app, pilot, "c", "r")

        def broken(*_: object) -> None:
            raise s2rstore.errors.RequestError("a page of the index is damaged")

        monkeypatch.setattr(navigation, "_settle", broken)
        gate.set()
        await settle(app, pilot)
        state = app.session.state
        assert (state.run, state.pending) == ("vanilla", None)
        assert (state.message, state.is_error) == ("a page of the index is damaged", True)


@pytest.mark.parametrize("is_error", [False, True])
def test_what_was_told_meanwhile_stays_as_a_run_arrives(store: Path, is_error: bool) -> None:
    session = Session(store)
    begun(session, pending=PendingTarget("b", session.state.generation))
    session.show_message("wrote rows.csv", is_error)
    state = session.complete_pending()
    assert (state.run, state.message, state.is_error) == ("b", "wrote rows.csv", is_error)
    assert session.set_cursor(1).message == ""
    session.close()


def test_words_about_a_selection_go_as_a_run_arrives(store: Path) -> None:
    session = Session(store)
    session.select("none")
    begun(session, pending=PendingTarget("b", session.state.generation, text="all"))
    assert session.state.message == "nothing is selected"
    assert session.complete_pending().message == ""
    session.close()


async def test_a_newer_generation_is_read_elsewhere(
    store_copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pending_target, "SMALL_STORE", 0)
    app = make_app(store_copy)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        before = app.session.store
        add_run(store_copy, "later", "vanilla", None, None, {"sim": [], "real": []})
        await press(app, pilot, "w", "g")
        await settle(app, pilot)
        state = app.session.state
        assert app.session.store is not before
        assert state.generation == app.session.store.generation == before.generation + 1
        assert (state.run, state.pending, state.expression) == ("vanilla", None, "worst15")
        assert state.message == f"generation {state.generation}"


async def test_a_saved_run_is_told_once_its_generation_is_read(
    store_copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pending_target, "SMALL_STORE", 0)
    app = make_app(store_copy)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        add_run(store_copy, "later", "vanilla", None, None, {"sim": [], "real": []})
        progress = JobProgress(1.0, "published", "done")
        app.post_message(RunSaveProgressed("dataaug", progress))
        await settle(app, pilot)
        assert app.session.state.generation == app.session.state.newest > 1
        assert app.session.state.message == "run dataaug is saved: r shows it"


@pytest.mark.parametrize("present", range(4))
@pytest.mark.parametrize("saved", range(4))
async def test_what_turns_to_a_saved_run_is_true(four_runs: Path, present: int, saved: int) -> None:
    app = make_app(four_runs)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        runs = app.session.state.runs
        app.session.set_run(runs[present])
        app.post_message(RunSaveProgressed(runs[saved], JobProgress(1.0, "published", "done")))
        await settle(app, pilot)
        told = app.session.state.message
        assert told.startswith(f"run {runs[saved]} is saved")
        if ": " not in told:
            assert present == saved
        elif "click" in told:
            assert (saved - present) % 4 == 2
        else:
            await press(app, pilot, told.split(": ")[1][0])
            assert app.session.state.run == runs[saved]


def test_brush_and_operator_stay_in_a_newer_generation(store_copy: Path) -> None:
    session = Session(store_copy)
    brush, _ = begun(session)
    add_run(store_copy, "later", "vanilla", None, None, {"sim": [], "real": []})
    state = session.open_newest_generation()
    assert state.generation == session.store.generation > 1
    assert (state.brush, state.operator) == (brush, "union")
    session.close()


def test_a_newer_generation_leaves_a_selection_waiting(
    store_copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pending_target, "SMALL_STORE", 0)
    session = Session(store_copy)
    session.defers_loading = True
    session.select("real.loss > 0")
    brush, _ = begun(session)
    add_run(store_copy, "later", "vanilla", None, None, {"sim": [], "real": []})
    session.open_newest_generation()
    assert session.state.message.endswith(f"of generation {session.store.latest_generation()}")
    state = session.complete_pending(s2rstore.open(store_copy))
    assert (state.generation, state.expression) == (session.store.generation, "real.loss > 0")
    assert (state.generation, state.brush) == (state.newest, brush)
    session.close()


async def test_a_left_store_is_closed_once_nobody_reads_it(store_copy: Path) -> None:
    app, entered, go_on = make_app(store_copy), threading.Event(), threading.Event()
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        before = app.session.store
        add_run(store_copy, "later", "vanilla", None, None, {"sim": [], "real": []})
        app.load_scheduler._workers["lines"].put(lambda: (entered.set(), go_on.wait(20)))
        assert entered.wait(10)
        await press(app, pilot, "g")
        app.load_results.check_store()
        assert app.session.store is not before
        assert before.execute("SELECT 1") == [(1,)]
        go_on.set()
        await settle(app, pilot)
        while not app.load_scheduler.idle:
            await pilot.pause()
        app.load_results.check_store()
        with pytest.raises(s2rstore.errors.RequestError, match="is closed"):
            before.execute("SELECT 1")
        assert not before._columns.nbytes


async def test_nothing_holds_a_store_that_was_left(store_copy: Path) -> None:
    """Not the lanes, nor their timers, nor the views that are not seen."""
    app = make_app(store_copy)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        for key in "123456":
            await press(app, pilot, key)
            await settle(app, pilot)
        before = weakref.ref(app.session.store)
        add_run(store_copy, "later", "vanilla", None, None, {"sim": [], "real": []})
        await press(app, pilot, "g")
        await settle(app, pilot)
        while not app.load_scheduler.idle:
            await pilot.pause()
        app.load_results.check_store()
        await pilot.pause()
        gc.collect()
        held = before()
        assert held is None


def begun(session: Session, **fields: object) -> tuple[Brush, State]:
    """With a brush and an operator."""
    brush = Brush("map", Mark("map", ((1.0, 1.0), (3.0, 2.0))))
    state = replace(session.state, brush=brush, operator="union", **fields)
    return brush, session.set_state(state)


def test_brush_and_operator_stay_as_an_awaited_run_arrives(store: Path) -> None:
    session = Session(store)
    brush, before = begun(session, pending=PendingTarget("b", session.state.generation))
    state = session.complete_pending()
    assert (state.run, state.pending) == ("b", None)
    assert (state.brush, state.operator) == (brush, before.operator)
    session.close()


def test_the_awaited_run_may_be_gone_from_the_newer_generation(store_copy: Path) -> None:
    session = Session(store_copy, "vanilla")
    begun(session, pending=PendingTarget("vanilla", session.state.generation + 1))
    add_run(store_copy, "later", "vanilla", None, None, {"sim": [], "real": []})
    fresh = s2rstore.open(store_copy)
    del fresh.runs["vanilla"]
    state = session.complete_pending(fresh)
    assert session.store is fresh
    assert (state.run, state.pending, state.brush) == ("dataaug", None, None)
    session.close()


def test_a_generation_that_cannot_be_entered_changes_nothing(
    store_copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = Session(store_copy)
    add_run(store_copy, "later", "vanilla", None, None, {"sim": [], "real": []})
    store, state, fresh = session.store, session.state, s2rstore.open(store_copy)
    monkeypatch.setattr(type(fresh), "arrays", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        session.complete_pending(fresh)
    assert (session.store, session.state) == (store, state)
    assert store.execute("SELECT 1") == [(1,)]
    with pytest.raises(s2rstore.errors.RequestError, match="is closed"):
        fresh.execute("SELECT 1")
    session.close()


def test_a_session_alone_reads_at_once(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pending_target, "SMALL_STORE", 0)
    session = Session(store)
    assert session.change_run(1).run == "b"
    session.close()


def test_what_two_threads_ask_for_is_made_once() -> None:
    kept, made, entered = LruCache(1000), [], threading.Event()
    go_on = threading.Event()

    def slow() -> np.ndarray:
        made.append(1)
        entered.set()
        assert go_on.wait(10)
        return np.zeros(4)

    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(kept.get, "key", slow)
        assert entered.wait(10)
        second = pool.submit(kept.get, "key", slow)
        go_on.set()
        assert first.result(10) is second.result(10)
    assert made == [1]


def test_what_failed_is_made_by_the_next() -> None:
    kept = LruCache(1000)
    with pytest.raises(ZeroDivisionError):
        kept.get("key", lambda: 1 / 0)
    assert kept.get("key", lambda: np.ones(3)).sum() == 3


def test_a_run_in_use_is_not_forgotten(store: Path) -> None:
    with s2rstore.open(store) as own:
        own.in_use = frozenset({"vanilla"})
        kept = {run: own.run_columns(run).real.error for run in ("vanilla", "b")}
        for run in kept:
            own.drop_run_columns(run)
        assert own.run_columns("vanilla").real.error is kept["vanilla"]
        assert own.run_columns("b").real.error is not kept["b"]


def test_a_store_is_opened_at_an_earlier_generation(store_copy: Path) -> None:
    with s2rstore.open(store_copy) as before:
        add_run(store_copy, "later", "vanilla", None, None, {"sim": [], "real": []})
        with s2rstore.open(store_copy, generation=before.generation) as again:
            assert again.generation == before.generation
            assert "later" not in again.runs
    with s2rstore.open(store_copy) as newest:
        assert "later" in newest.runs
    with pytest.raises(s2rstore.errors.RequestError, match="missing"):
        s2rstore.open(store_copy, generation=999)


def test_keys_look_at_no_file(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a floor plan depends on is asked at every key."""
    session = Session(store)
    monkeypatch.setattr(type(session.store), "floor_plan_path", lambda _: 1 / 0)
    wanted = store_data.floor_plan_key(session.store, session.state)
    assert (wanted is None) == (session.store.dataset.floor_plan is None)
    session.close()


def test_the_screen_of_a_state_shows_its_nights(
    store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nights = tmp_path / "nights.duckdb"
    nights.touch()
    session = Session(store, gap_history=nights)
    opened: list[Session] = []
    monkeypatch.setattr(headless, "S2RApp", lambda made, look: opened.append(made) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        headless.screen_of(store, session.state, (800, 480), RenderOptions())
    assert opened[0].state is session.state
    assert opened[0].store.in_use == {session.state.run}
    assert not opened[0].check_for_updates()
    for each in (session, *opened):
        each.close()
