"""Leaving while something is under way: at once, with a word on what lacks, nothing left over."""

from __future__ import annotations

import asyncio
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
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtui.app import load_scheduler
from s2rtui.app.app import S2RApp
from s2rtui.canvas import RenderOptions
from s2rtui.cli import main
from s2rtui.loaders import LOADERS
from s2rtui.session import Session
from tests.support.copies import copy_store
from tests.support.silent_reporter import SilentReporter

pytestmark = pytest.mark.xdist_group("world")

AT_ONCE = 5.0
"""Seconds; a second is meant, and a busy machine is slow."""
OpenScreen = Callable[..., Screen]


@pytest.fixture
def open_screen(tmp_path: Path) -> Iterator[OpenScreen]:
    opened: list[Screen] = []

    def opener(*words: str, size: tuple[int, int] = (120, 40)) -> Screen:
        environment = {
            "XDG_DATA_HOME": str(tmp_path / "share"),
            "PYTHONPATH": ":".join(path for path in sys.path if path),
            "OMP_NUM_THREADS": "1",
        }
        command = [sys.executable, "-m", "s2rtui", *words]
        opened.append(Screen(command, size, environment))
        return opened[-1]

    yield opener
    for screen in opened:
        screen.close()


@pytest.fixture(scope="module")
def computed(trained_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = copy_store(trained_store, tmp_path_factory.mktemp("leaving") / "s.s2r")
    precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(("feature_distance",)))
    return path


def opened(open_screen: OpenScreen, store: Path) -> Screen:
    screen = open_screen("tui", str(store))
    return begun(screen)


def begun(screen: Screen) -> Screen:
    """After the tour of the first start."""
    screen.wait_for("any key begins")
    screen.press("\x1b")
    screen.wait_for("2 map")
    return screen


def left(screen: Screen) -> str:
    """What the terminal shows after `q`, which must end it at once and well."""
    began = time.monotonic()
    screen.press("q")
    assert screen.wait_for_end(20) == 0
    assert time.monotonic() - began < AT_ONCE
    assert b"\x1b[?1049l" in screen.raw
    return after(screen)


def after(screen: Screen) -> str:
    """The words on the terminal once the application has given it back."""
    told = screen.raw.rpartition(b"\x1b[?1049l")[2].decode()
    return re.sub(r"\x1b\[[?<>=0-9;]*[a-zA-Z]", "", told).strip()


def test_while_a_run_is_saved(computed: Path, tmp_path: Path, open_screen: OpenScreen) -> None:
    path = copy_store(computed, tmp_path / "own.s2r")
    screen = opened(open_screen, path)
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
    told = left(screen)
    assert "run brighter is not saved yet" in told
    assert "precompute" in told
    assert wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in below))
    with s2rstore.open(path) as store:
        assert store.run("brighter").key is None
    assert main(["precompute", str(path), "--run", "brighter", "--kinds", "activation"]) == 0


def test_while_a_model_is_loaded(computed: Path, open_screen: OpenScreen) -> None:
    screen = opened(open_screen, computed)
    screen.press("a")
    screen.wait_for("loading the model")
    assert left(screen) == ""


@pytest.mark.parametrize("feed", ["pictures", "heat on the map", "live"])
async def test_while_a_feed_is_read(
    tiny_store: Path, monkeypatch: pytest.MonkeyPatch, feed: str
) -> None:
    reading, go_on = threading.Event(), threading.Event()

    def endless(*_: object) -> dict[str, object]:
        reading.set()
        go_on.wait(30)
        return {}

    changed = tuple(
        replace(one, read=endless, request_key=lambda *_: (1,), is_debounced=False)
        if one.name == feed
        else one
        for one in LOADERS
    )
    monkeypatch.setattr(load_scheduler, "LOADERS", changed)
    app = S2RApp(Session(tiny_store), RenderOptions())
    began = 0.0
    try:
        async with app.run_test(size=(120, 40)) as pilot:
            assert await asyncio.to_thread(reading.wait, 5)
            began = time.monotonic()
            await pilot.press("q")
        assert time.monotonic() - began < AT_ONCE
        assert app.return_code == 0
    finally:
        go_on.set()


def test_a_fault_is_told_in_one_line(
    tiny_store: Path, tmp_path: Path, open_screen: OpenScreen
) -> None:
    folder = tmp_path / "broken"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(
        "import s2rtui.session.view_settings as showing\n"
        "def broken(*arguments):\n"
        "    raise KeyError('no such thing')\n"
        "showing.change_map_mode = broken\n"
    )
    sys.path.insert(0, str(folder))
    try:
        screen = open_screen("tui", str(tiny_store))
    finally:
        sys.path.remove(str(folder))
    begun(screen).press("m")
    assert screen.wait_for_end(20) == 70
    assert after(screen) == ("s2r: internal error: KeyError: 'no such thing' (--debug shows where)")
