"""Eight simultaneous users while a precompute publishes: no errors and no inconsistent data."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import s2rstore
from bench.support.replay import STATUS, faults
from bench.support.screen import LEFT, RIGHT, Screen
from bench.support.sshd import Sshd, application
from s2rstore.files import layout
from s2rstore.maintenance.verify import verify
from s2rtui.cli import main
from tests.support.copies import copy_store

pytestmark = pytest.mark.deep
OpenScreen = Callable[..., Screen]
USERS = 8
KINDS = "activation,feature_distance"
KEYS = ("w", "b", "W", "B", "c", RIGHT, LEFT, "r", "R", "h", "v", "o", "d", "m", "+", "0", "u")


@pytest.fixture
def computed(trained_store: Path, tmp_path: Path) -> Path:
    """A computed store with two additional runs that are not computed yet."""
    path = copy_store(trained_store, tmp_path / "s.s2r")
    assert main(["precompute", str(path), "--kinds", KINDS]) == 0
    for number in (1, 2):
        adjust = f"real:brightness=1.{number}"
        arguments = ["run", "add", f"more{number}", "--model", "vanilla", "--adjust", adjust]
        assert main([*arguments, "--store", str(path)]) == 0
    return path


def _call(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "s2rtui", *arguments]


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}


def _publishing(path: Path) -> Iterator[None]:
    """Yields while a precompute of the added runs is running."""
    arguments = _call("precompute", str(path), "--kinds", KINDS)
    writer = subprocess.Popen(
        arguments, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=_environment()
    )
    while writer.poll() is None:
        yield
    _, error_output = writer.communicate()
    assert writer.returncode == 0, error_output


def test_eight_users_while_a_precompute_publishes(
    server: Sshd, computed: Path, open_screen: OpenScreen
) -> None:
    first = layout.read_current(computed).generation
    screens = [open_screen(server.login(*application(computed)), (120, 40)) for _ in range(USERS)]
    for screen in screens:
        screen.wait_for("of 40", 120)
    rng = random.Random(0)
    for _ in _publishing(computed):
        before = [screen.received for screen in screens]
        for screen in screens:
            screen.press(rng.choice(KEYS))
        for screen, received in zip(screens, before, strict=True):
            screen.wait_for_bytes(received, 0.5)
            text = screen.wait_for(lambda text: bool(STATUS.search(text)))
            assert faults(text.splitlines()) == [], text
            status = STATUS.search(text)
            assert status is not None
            assert (int(status["all"]), int(status["generation"])) == (40, first)
    newest = layout.read_current(computed).generation
    assert newest > first
    for screen in screens:
        screen.press("c")
        screen.wait_for("│ 8 of 40 (32 trained on) │", 120)
        screen.wait_for(f"({newest} available")
        screen.press("g")
        screen.wait_for(lambda text: text.splitlines()[0].endswith(f"generation {newest}"))
        screen.press("w")
        screen.wait_for("│ 2 of 40 (32 trained on) │")
    for screen in screens:
        screen.press("q")
        assert screen.wait_for_end(120) == 0
    assert verify(computed) == []
    with s2rstore.open(computed) as store:
        assert {"more1", "more2"} <= {name for name, run in store.runs.items() if run.key}
