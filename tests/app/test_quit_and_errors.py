"""Quitting leaves no process; errors are shown in one line; a restricted session."""

import asyncio
import os
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

import s2rstore
from bench.support.processes import commands_below, wait_until
from bench.support.screen import RIGHT, Screen
from s2rtui.app import load_scheduler
from s2rtui.app.app import S2RApp
from s2rtui.app.controllers.navigation import NavigationController
from s2rtui.app.pilot import settle
from s2rtui.canvas import RenderOptions
from s2rtui.charts.map import VIEW as MAP
from s2rtui.cli import main
from s2rtui.loaders import LOADERS
from s2rtui.session.session import Session
from tests.support.application import press, running
from tests.support.copies import copy_store
from tests.support.terminals import open_application

MAX_QUIT_SECONDS = 5.0
"""Upper limit on a busy machine; usually less than one second."""
OpenApplication = Callable[..., Screen]


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[OpenApplication]:
    """Open the application, and close the tour of the first start."""
    screens: list[Screen] = []

    def start(store: Path, *options: str) -> Screen:
        screens.append(open_application(store, tmp_path / "share", *options))
        screens[-1].wait_for("any key begins")
        screens[-1].press("\x1b")
        screens[-1].wait_for("2 map")
        return screens[-1]

    yield start
    for screen in screens:
        screen.close()


def quit_application(screen: Screen) -> str:
    """Quit with `q`: the process must end at once with exit code 0; return the final output."""
    start = time.monotonic()
    screen.press("q")
    assert screen.wait_for_end(20) == 0
    assert time.monotonic() - start < MAX_QUIT_SECONDS
    assert b"\x1b[?1049l" in screen.raw
    return output_after_exit(screen)


def output_after_exit(screen: Screen) -> str:
    """The text written after the application has left the alternate screen."""
    text = screen.raw.rpartition(b"\x1b[?1049l")[2].decode()
    return re.sub(r"\x1b\[[?<>=0-9;]*[a-zA-Z]", "", text).strip()


def test_quit_while_a_run_is_saved(few_pairs_store, tmp_path, opened):
    path = copy_store(few_pairs_store, tmp_path / "own.s2r")
    screen = opened(path, "--with-trained")
    screen.press("a")
    screen.wait_for("brightness")
    screen.press(RIGHT)
    screen.wait_for("1.05 factor")
    screen.press("S")
    screen.wait_for("a name for the run")
    screen.press("brighter\r")
    screen.wait_for("run brighter:")
    assert wait_until(lambda: len(commands_below(screen.pid)) > 0)
    below = commands_below(screen.pid)
    message = quit_application(screen)
    assert "run brighter is not saved yet" in message
    assert "precompute" in message
    assert wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in below))
    with s2rstore.open(path) as store:
        assert store.run("brighter").key is None
    assert main(["precompute", str(path), "--run", "brighter", "--kinds", "activation"]) == 0


def test_quit_while_a_model_loads(few_pairs_store, opened):
    screen = opened(few_pairs_store, "--with-trained")
    screen.press("a")
    screen.wait_for("loading the model")
    assert quit_application(screen) == ""


@pytest.mark.parametrize("loader", ["pictures", "live"])
async def test_quit_while_a_loader_reads(tiny_store, monkeypatch, loader):
    reading, release = threading.Event(), threading.Event()

    def blocking_read(*_: object) -> dict[str, object]:
        reading.set()
        release.wait(30)
        return {}

    changed = tuple(
        replace(candidate, read=blocking_read, request_key=lambda *_: (1,), is_debounced=False)
        if candidate.name == loader else candidate for candidate in LOADERS
    )  # fmt: skip
    monkeypatch.setattr(load_scheduler, "LOADERS", changed)
    app = S2RApp(Session(tiny_store), RenderOptions())
    start = 0.0
    try:
        async with app.run_test(size=(120, 40)) as pilot:
            assert await asyncio.to_thread(reading.wait, 60)
            start = time.monotonic()
            await pilot.press("q")
        assert time.monotonic() - start < MAX_QUIT_SECONDS
        assert app.return_code == 0
    finally:
        release.set()


def test_an_unexpected_error_at_the_start_is_printed_in_one_line(tiny_store, tmp_path):
    folder = tmp_path / "broken"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(
        "from s2rtui.app.app import S2RApp\n"
        "def broken(*arguments):\n"
        "    raise KeyError('no such thing')\n"
        "S2RApp.on_mount = broken\n"
    )
    path = os.pathsep.join([str(folder), *filter(None, sys.path)])
    screen = open_application(tiny_store, tmp_path / "share", PYTHONPATH=path)
    try:
        assert screen.wait_for_end(20) == 70
    finally:
        screen.close()
    assert output_after_exit(screen) == (
        "s2r: internal error: KeyError: 'no such thing' (--debug shows the traceback)"
    )


def fail(*arguments: object) -> None:
    raise KeyError("no such thing")


@pytest.mark.parametrize("keys", [("V",), ("x", "right", "enter"), "drag"])
async def test_an_unexpected_error_is_shown_and_the_application_runs_on(
    tiny_store, monkeypatch, keys
):
    monkeypatch.setattr(NavigationController, "fill_screen", fail)
    monkeypatch.setattr(type(MAP), "to_expression", fail)
    async with running(tiny_store) as (app, pilot):
        if keys == "drag":
            await pilot.mouse_down("#map", offset=(20, 10))
            await pilot.mouse_up("#map", offset=(40, 20))
        else:
            await pilot.press(*keys)
        monkeypatch.undo()
        await settle(app, pilot)
        assert app.fault is None
        assert app.session.state.message == "internal error: KeyError: 'no such thing'"
        assert app.session.state.is_error
        await pilot.press("escape", "escape", "w")
        await settle(app, pilot)
        assert app.session.state.expression == "worst15"


async def test_a_state_that_cannot_be_drawn_is_left(tiny_store, monkeypatch):
    async with running(tiny_store) as (app, pilot):
        before = app.session.state
        draw = type(MAP).draw

        def draw_one_mode(self: object, scene, *arguments: object):
            return draw(self, scene, *arguments) if scene.state.map_mode == "colour" else fail()

        monkeypatch.setattr(type(MAP), "draw", draw_one_mode)
        await press(app, pilot, "m")
        assert app.fault is None
        assert app.session.state.map_mode == before.map_mode
        assert "internal error" in app.session.state.message
