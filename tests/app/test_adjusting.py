"""The adjustment panel: sliders, live predictions, release of the model and saved runs."""

import asyncio
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rtools.adjustments import ADJUSTMENTS, ImageAdjustment, make_chain
from s2rtools.interactive import LiveModel
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.run_registration import add_run
from s2rtui.app.app import S2RApp
from s2rtui.app.controllers import adjust
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.canvas import RenderOptions
from s2rtui.charts.registry import BY_NAME
from s2rtui.jobs.command_job import JobProgress
from s2rtui.loaders import live_prediction
from s2rtui.session import view_settings
from s2rtui.session.session import Session
from s2rtui.session.state import Adjust
from tests.support.application import make_app, press, running
from tests.support.copies import copy_store
from tests.support.silent_reporter import SilentReporter


async def test_moving_a_slider_shows_the_live_prediction(few_pairs_store):
    async with running(few_pairs_store, with_trained=True) as (app, pilot):
        await press(app, pilot, "a", *["right"] * 3)
        adjust, shown = app.session.state.adjust, app.loaded.live
        names = [slider.name for slider in adjust.sliders]
        assert names == [a.name for a in ADJUSTMENTS.values() if isinstance(a, ImageAdjustment)]
        assert "cameras cannot be moved" in adjust.reason
        brightness = adjust.value(("real", "brightness"))
        assert brightness == pytest.approx(1 + 3 * ADJUSTMENTS["brightness"].step)
        assert f"{brightness:g} factor" in take_screenshot(app).text
        with s2rstore.open(few_pairs_store) as store:
            model = LiveModel(store, "vanilla")
            chains = {"real": make_chain("real", {"brightness": brightness})}
            expected = model.compute(shown.iid, chains)
            model.close()
        assert shown.real.pose.x == pytest.approx(expected.real.x, abs=1e-5)
        assert (shown.real.rgb == expected.real.rgb).all()
        poses = dict(_map_input(app).live)
        assert poses["real"][0] == pytest.approx(expected.real.x, abs=1e-5)
        await press(app, pilot, "down", "left", "backspace", "up", "backspace")
        shown, adjust = app.loaded.live, app.session.state.adjust
        assert all(adjust.value(slider.key) == slider.neutral for slider in adjust.sliders)
        columns = app.session.store.run_columns("vanilla").real
        assert shown.real.pose.error == pytest.approx(columns.error[shown.iid], abs=1e-4)


def _map_input(app: S2RApp):
    return BY_NAME["map"].input(app.updater.scene)


async def test_a_synthetic_world_renders_moved_sim_cameras(moved_camera_store):
    async with running(moved_camera_store, with_trained=True) as (app, pilot):
        await press(app, pilot, "a")
        before = app.loaded.live
        await press(app, pilot, "up", "right", "right")
        adjust, after = app.session.state.adjust, app.loaded.live
        assert adjust.reason == ""
        assert adjust.value(("sim", "camera_fov")) > 0
        assert (before.sim.rgb != after.sim.rgb).mean() > 0.2
        assert (before.real.rgb == after.real.rgb).all()


class FinishedJob:
    """A run computed in this process; tests/session checks the processes that do it otherwise."""

    def __init__(self, path: Path, run: str, source: str, chains: dict) -> None:
        self.run = run
        add_run(path, run, source, None, None, chains)
        precompute(path, SilentReporter(), [run], PrecomputeOptions(("feature_distance",)))

    def follow(self) -> Iterator[JobProgress]:
        yield JobProgress(0.5, "forward", "")
        yield JobProgress(1.0, "", "done")


async def test_adjustments_are_saved_as_a_run(few_pairs_store, tmp_path, monkeypatch):
    monkeypatch.setattr(adjust, "save_run", FinishedJob)
    path = copy_store(few_pairs_store, tmp_path / "own.s2r")
    async with running(path, with_trained=True) as (app, pilot):
        await press(app, pilot, "a", "right", "right", "S")
        await pilot.press(*"brighter", "enter")
        while "brighter" not in app.session.state.runs:
            await pilot.pause(0.05)
            assert not app.session.state.is_error, app.session.state.message
        run = app.session.store.run("brighter")
        assert run.real_adjustments == make_chain("real", {"brightness": 1.1})
        await settle(app, pilot)
        assert "brighter" in take_screenshot(app).text


async def test_one_run_is_saved_at_a_time(few_pairs_store, tmp_path, monkeypatch):
    started: list[str] = []
    release = threading.Event()

    def blocking_save(root: Path, name: str, *_: object) -> None:
        started.append(name)
        release.wait(20)
        raise RequestError("nothing is saved here")

    monkeypatch.setattr(adjust, "save_run", blocking_save)
    async with running(few_pairs_store, with_trained=True) as (app, pilot):
        await press(app, pilot, "a", "right")
        await pilot.press("S", *"one", "enter")
        await pilot.pause()
        assert "run one: checking" in take_screenshot(app).text
        await pilot.press("S")
        await pilot.pause()
        assert not app.prompt.is_open
        assert "run one is still being computed" in take_screenshot(app).text
        with pytest.raises(RequestError, match="run one is still being computed"):
            app.adjust.save("two", lambda: blocking_save(few_pairs_store, "two"))
        release.set()
        await settle(app, pilot)
        assert started == ["one"]
        assert app.session.state.message == "run one: nothing is saved here"
        await pilot.press("S")
        await pilot.pause()
        assert app.prompt.is_open


async def test_refused_names_and_failed_saves_show_an_error(few_pairs_store, monkeypatch):
    def failing_save(*_: object) -> None:
        raise ModuleNotFoundError("No module named 'torch'", name="torch")

    async with running(few_pairs_store, with_trained=True) as (app, pilot):
        await press(app, pilot, "a", "right", "S", "enter")
        assert "type a name for the run" in app.session.state.message
        await press(app, pilot, *"vanilla", "enter")
        assert "already" in app.session.state.message
        assert app.session.state.is_error
        await press(app, pilot, "escape")
        monkeypatch.setattr(adjust, "save_run", failing_save)
        await press(app, pilot, "S", *"one", "enter")
        assert app.session.state.is_error
        assert "this needs torch: pip install 's2rtui[tools]'" in app.session.state.message


def unload_tools(monkeypatch: pytest.MonkeyPatch) -> None:
    """Remove modules of `s2rtools` until the test ends, from `sys.modules` and their packages.

    A module that the test imports again would otherwise stay in its package after `sys.modules`
    has been restored, and later tests would see two copies of it.
    """
    for name in [name for name in sys.modules if name.startswith("s2rtools.")]:
        package, _, attribute = name.rpartition(".")
        if package in sys.modules:
            monkeypatch.delattr(sys.modules[package], attribute, raising=False)
        monkeypatch.delitem(sys.modules, name)


async def test_the_panel_explains_how_to_install_torch(tiny_store, monkeypatch):
    unload_tools(monkeypatch)
    for name in [name for name in sys.modules if name.split(".")[0] == "torch"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    async with running(tiny_store) as (app, pilot):
        await press(app, pilot, "a", "right")
        text = " ".join(take_screenshot(app).text.split())
        assert "live adjustments need torch: pip install 's2rtui[tools]'" in text
        assert "loading the model" not in text
        assert "run vanilla: not adjusted" in text
        assert "brightness" in text
        await press(app, pilot, "2", "w")
        assert app.session.state.expression == "worst15"
        assert app.loaded.pictures is not None


async def test_a_failed_model_is_not_shown_as_loading(few_pairs_store, monkeypatch):
    async with running(few_pairs_store, with_trained=True) as (app, pilot):
        await press(app, pilot, "a")
        monkeypatch.setattr(LiveModel, "steps", lambda *_: iter([1 / 0]))
        await press(app, pilot, "right")
        text = take_screenshot(app).text
        assert "run vanilla: not adjusted" in text
        assert "loading the model" not in text
        assert "division by zero" in text
        monkeypatch.undo()
        await press(app, pilot, "right")
        assert "not adjusted" not in take_screenshot(app).text
        assert app.loaded.live is not None


async def test_a_running_prediction_is_shown_while_newer_values_wait(few_pairs_store, monkeypatch):
    app = make_app(few_pairs_store, with_trained=True)
    started, release = threading.Semaphore(0), threading.Semaphore(0)
    steps = LiveModel.steps
    values: list[float] = []

    def blocking_steps(model: LiveModel, iid: int, chains, *rest):
        values.append(chains["real"][0]["value"] if chains["real"] else 1.0)
        started.release()
        assert release.acquire(timeout=20)
        yield from steps(model, iid, chains, *rest)

    async with app.run_test(size=(120, 40)) as pilot:
        await press(app, pilot, "a")
        before = app.loaded.live
        monkeypatch.setattr(LiveModel, "steps", blocking_steps)
        await pilot.press("right")
        assert await asyncio.to_thread(started.acquire, timeout=20)
        await pilot.press(*["right"] * 9)
        release.release()
        assert await asyncio.to_thread(started.acquire, timeout=20)
        await pilot.pause()
        # The result of the first move, although nine moves followed.
        assert app.loaded.live is not before
        assert not app.settled
        release.release()
        await settle(app, pilot)
        step = ADJUSTMENTS["brightness"].step
        assert values == pytest.approx([1 + step, 1 + 10 * step])


def test_the_live_model_uses_the_generation_of_the_session(few_pairs_store, tmp_path):
    path = copy_store(few_pairs_store, tmp_path / "own.s2r")
    with s2rstore.open(path) as store:
        add_run(path, "later", "vanilla", None, None, {"sim": [], "real": []})
        model = LiveModel(store, "vanilla")
        assert model._store.generation == store.generation
        assert "later" not in model._store.runs
        model.close()


async def test_clicking_other_views_keeps_the_panel_and_the_live_marks(few_pairs_store):
    async with running(few_pairs_store, with_trained=True, size=(200, 60)) as (app, pilot):
        await press(app, pilot, "a", "right")
        live = _map_input(app).live
        assert live
        for view in ("umap", "orientation", "rooms", "errors", "overview", "map"):
            await pilot.click(f"#{view}", offset=(3, 0))
            await settle(app, pilot)
            assert app.session.state.view == view
            assert app.query_one("#adjust").placed
            assert _map_input(app).live == live
        await press(app, pilot, "4")
        assert app.query_one("#adjust").placed
        await pilot.resize_terminal(120, 40)
        await settle(app, pilot)
        assert app.query_one("#umap").placed
        await press(app, pilot, "3")
        assert not _map_input(app).live


class RecordingPredictor:
    """Records its calls."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.read = lambda *_: self.calls.append("read") or {}
        self.release = lambda: self.calls.append("leave")


async def test_a_hidden_panel_releases_the_model(tiny_store, monkeypatch):
    predictor = RecordingPredictor()
    monkeypatch.setattr(live_prediction, "_PREDICTOR", predictor)
    app = S2RApp(Session(tiny_store), RenderOptions())
    app.load_scheduler.debounce_seconds, app.load_scheduler.release_seconds = 0.001, 0.05
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        await press(app, pilot, "a")
        assert predictor.calls == ["read"]
        await asyncio.sleep(0.2)
        assert predictor.calls == ["read"]
        app.session.dispatch(view_settings.show_view, "instance", "tab")
        app.updater.refresh()
        await press(app, pilot, "n")
        async with asyncio.timeout(10):
            while predictor.calls == ["read"]:
                await pilot.pause()
        assert predictor.calls == ["read", "leave"]
        await press(app, pilot, "a")
        assert predictor.calls == ["read", "leave", "read"]


def test_another_order_of_the_steps_is_predicted_again(tiny_store):
    session = Session(tiny_store)
    steps = (("real", "brightness"), ("real", "contrast"))
    states = [
        replace(session.state, tab="adjust", adjust=Adjust(session.state.run, run_steps=order))
        for order in (steps, steps[::-1])
    ]
    first, second = (live_prediction.live_key(session.store, state) for state in states)
    assert first != second
