"""Data on the screen is labelled with its origin while newer data is loading."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from textual.pilot import Pilot

from s2rtui.app import load_scheduler
from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.charts.registry import BY_NAME
from s2rtui.charts.shared.instance_input import instance_input
from s2rtui.loaders import LOADERS
from s2rtui.session.provenance import instance_provenance
from s2rtui.session.state import Adjust, Slider
from tests.support.application import make_app, press, running

LONG_DELAY_SECONDS = 60.0
SLIDER = Slider("real", "brightness", 0.5, 1.5, 1.0, 0.05, "")


async def press_without_loading(app: S2RApp, pilot: Pilot[None], *keys: str) -> None:
    """Press keys; their data arrives much later."""
    app.load_scheduler.debounce_seconds = LONG_DELAY_SECONDS
    for key in keys:
        await pilot.press(key)
        await pilot.pause()


def subtitle(app: S2RApp, view: str) -> str:
    return BY_NAME[view].subtitle(app.updater.scene)


def loading(app: S2RApp, view: str) -> str:
    return BY_NAME[view].loading(app.updater.scene)


async def test_images_keep_label_and_place_until_new_ones_arrive(tiny_store):
    def first_image_row() -> int:
        rows = take_screenshot(app).text.splitlines()
        return next(n for n, row in enumerate(rows) if "◆ sim" in row and "◇ real" in row)

    async with running(tiny_store) as (app, pilot):
        for key, other in (
            ("right", lambda s: f"{s.cursor}"), ("h", lambda s: s.heat.label),
            ("r", lambda s: f"run {s.run}"),
        ):  # fmt: skip
            app.load_scheduler.debounce_seconds = 0.001
            await press(app, pilot, "c")
            before, state, row = subtitle(app, "instance"), app.session.state, first_image_row()
            assert before == f"{state.cursor}, {state.heat.label}"
            await press_without_loading(app, pilot, key)
            after = app.session.state
            assert subtitle(app, "instance") == before + (", run vanilla" if key == "r" else "")
            assert loading(app, "instance") == other(after)
            screen = take_screenshot(app).text
            assert f"3 instance  {before}"[:20] in screen
            assert f"(loading {other(after)})"[:20] in screen
            assert first_image_row() == row
            app.load_scheduler.debounce_seconds = 0.001
            await press(app, pilot, key)
            assert loading(app, "instance") == ""


async def test_a_live_prediction_is_shown_only_for_its_run_and_instance(tiny_store):
    async with running(tiny_store) as (app, pilot):
        await press(app, pilot, "c")
        session, state = app.session, app.session.state
        adjust = Adjust(state.run, ((SLIDER.key, 1.0),), 0, (SLIDER,))
        shown = instance_input(session.store, state.run, state.cursor, None)
        grid = np.ones((4, 4), dtype=np.float32)
        resources = replace(
            app.loaded, live=shown, live_source=instance_provenance(state), live_floor_heat=grid
        )
        panel_state = replace(state, adjust=adjust, view="adjust", tab="adjust", overlay="instance")
        plain = replace(app.updater.scene, loaded=resources)

        def scene(**changes: object):
            return replace(plain, state=replace(panel_state, **changes))

        assert BY_NAME["adjust"].subtitle(scene()).endswith(f"instance {state.cursor}")
        assert BY_NAME["map"].input(scene()).live
        assert BY_NAME["map"].input(scene()).floor.heat is not None
        other_run = scene(run="dataaug", adjust=replace(adjust, run="dataaug"))
        assert BY_NAME["adjust"].subtitle(other_run) == "run dataaug: loading the model"
        assert not BY_NAME["map"].input(other_run).live
        assert BY_NAME["map"].input(other_run).floor.heat is None
        moved = scene(cursor=7)
        assert f"instance {state.cursor} (loading 7)" in BY_NAME["adjust"].subtitle(moved)
        assert not BY_NAME["map"].input(moved).live
        assert BY_NAME["map"].input(moved).floor.heat is None


async def test_every_loader_reports_its_own_progress(tiny_store):
    async with running(tiny_store) as (app, pilot):
        await press(app, pilot, "c", "o", "C")
        tickets = app.load_scheduler._ticket
        for loader, share in (("heat on the map", 0.25), ("seen floor", 0.5)):
            app.load_scheduler.show_progress(loader, tickets[loader], share)
        app.load_scheduler.show_progress("live", -1, 0.9)
        await pilot.pause()
        text = take_screenshot(app).text
        assert "heat on the map 25%, seen floor 50%" in text
        app.load_scheduler.complete("seen floor", tickets["seen floor"], {})
        assert app.loaded.progress == {"heat on the map": 0.25}
        await press(app, pilot, "A")
        assert app.loaded.progress == {}


async def test_a_slow_loader_does_not_block_the_others(tiny_store, monkeypatch):
    release = threading.Event()
    started: list[int] = []

    def blocking_read(*_: object) -> dict[str, object]:
        started.append(1)
        release.wait(60)
        return {}

    changed = tuple(
        replace(loader, read=blocking_read, request_key=lambda _, state: (state.cursor,),
                is_debounced=False)
        if loader.name == "live" else loader for loader in LOADERS
    )  # fmt: skip
    monkeypatch.setattr(load_scheduler, "LOADERS", changed)
    app = make_app(tiny_store)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("3", *["n"] * 20)
        while (source := app.loaded.pictures_source) is None or (
            source.iid != app.session.state.cursor
        ):
            await pilot.pause(0.01)
        assert sum(started) == 1
        release.set()
        await settle(app, pilot)
        assert sum(started) == 2


@pytest.mark.parametrize(
    ("keys", "key", "label"),
    [("co", "n", ", of {}"), ("co", "h", None), ("coo", "w", "of an earlier selection")],
)
async def test_heat_of_an_earlier_state_is_labelled_or_hidden(tiny_store, keys, key, label):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, *keys)
        cursor = app.session.state.cursor
        await press_without_loading(app, pilot, key)
        shown = BY_NAME["map"].input(app.updater.scene)
        assert (shown.floor.heat is None) == (label is None)
        assert label is None or label.format(cursor) in shown.heat_label


@pytest.mark.parametrize("key", ["w", "d", "r"])
async def test_the_seen_floor_of_an_earlier_selection_is_not_used(tiny_store, key):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "c", "C")
        assert BY_NAME["map"].input(app.updater.scene).floor.seen is not None
        await press_without_loading(app, pilot, key)
        assert BY_NAME["map"].input(app.updater.scene).floor.seen is None
        assert "loading what the selection saw" in subtitle(app, "map")
