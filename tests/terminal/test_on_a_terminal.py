"""Pictures in true pixels over a pseudo-terminal that answers as kitty does."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from bench.support.screen import RIGHT, Screen
from s2rtui.app.app import S2RApp
from s2rtui.app.inline_images import enable_inline_images
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.canvas import RenderOptions
from s2rtui.canvas.colour import DEPTH_SHADES
from s2rtui.charts.shared.image_pair_model import InstanceInput, instance_model, panel_pixels
from s2rtui.session import Session
from s2rtui.terminal.graphics.kitty_protocol import PLACEHOLDER
from s2rtui.terminal.graphics.probe import parse_answer
from tests.support.kitty import (
    ANSWER,
    ATTRIBUTES,
    QUESTION_END,
    KittyTerminal,
    box_cells,
    placed_cells,
)

Visit = dict[str, bytes]


def opened(store: Path, share: Path, *words: str) -> Screen:
    environment = {
        "XDG_DATA_HOME": str(share),
        "PYTHONPATH": ":".join(path for path in sys.path if path),
        "COLORTERM": "truecolor",
        "OMP_NUM_THREADS": "1",
    }
    command = [sys.executable, "-m", "s2rtui", "tui", str(store), *words]
    return Screen(command, (120, 40), environment)


def awaited(screen: Screen, holds: Callable[[bytes], bool]) -> None:
    limit = time.monotonic() + 20
    while not holds(bytes(screen.raw)):
        assert time.monotonic() < limit, bytes(screen.raw)[-400:]
        time.sleep(0.01)


def answered(screen: Screen, answer: bytes) -> None:
    awaited(screen, lambda raw: QUESTION_END in raw)
    screen.press(answer)


def past_the_tour(screen: Screen) -> None:
    screen.wait_for("any key begins", 20)
    screen.press(b"\x1b")


@pytest.fixture(scope="module")
def seen(tiny_store: Path) -> InstanceInput:
    """What the first screen shows an instance's pictures of."""

    async def read() -> InstanceInput:
        app = S2RApp(Session(tiny_store), RenderOptions())
        app.load_scheduler.debounce_seconds = 0.001
        async with app.run_test(size=(120, 40)) as pilot:
            await settle(app, pilot)
            assert app.resources.pictures is not None
            return app.resources.pictures

    return asyncio.run(read())


@pytest.fixture(scope="module")
def visit(tiny_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Visit]:
    """The bytes that arrived after each step of a visit."""
    screen = opened(tiny_store, tmp_path_factory.mktemp("graphics"), "--graphics")
    parts: Visit = {}
    at = 0

    def part(name: str, holds: Callable[[bytes], bool]) -> None:
        nonlocal at
        awaited(screen, lambda raw: holds(raw[at:]))
        parts[name], at = bytes(screen.raw[at:]), len(screen.raw)

    answered(screen, ANSWER)
    part("asked", lambda raw: True)
    past_the_tour(screen)
    part("first", lambda raw: len(placed_cells(raw)) == 4 and all_whole(raw))
    for _ in range(5):
        screen.press(RIGHT)
        time.sleep(0.02)
    part("moved", lambda raw: len(placed_cells(raw)) == 4 and all_whole(raw))
    screen.press("?")
    part("help", lambda raw: b"straight driving" in raw)
    screen.press(b"\x1b")
    part("back", lambda raw: placed_cells(raw) == placed_cells(parts["moved"]))
    screen.resize(110, 36)
    part("resized", lambda raw: len(KittyTerminal.after(raw).images) == 4 and all_whole(raw))
    screen.press("q")
    assert screen.wait_for_end() == 0
    parts["left"], parts["all"] = bytes(screen.raw[at:]), bytes(screen.raw)
    yield parts
    screen.close()


def all_whole(raw: bytes) -> bool:
    """Whether every picture that was sent is placed with all its cells."""
    held, cells = KittyTerminal.after(raw).images, placed_cells(raw)
    return bool(held) and all(cells.get(at) == box_cells(*held[at].box) for at in held)


def test_what_is_sent_are_the_pictures_to_the_pixel(visit: Visit, seen: InstanceInput) -> None:
    model = instance_model(seen)
    sent = [held.pixels for held in KittyTerminal.after(visit["first"]).images.values()]
    wanted = [
        panel_pixels(side, what, model, seen, (16, 16), DEPTH_SHADES)
        for what in ("rgb", "depth")
        for side in (seen.sim, seen.real)
    ]
    assert len(sent) == len(wanted)
    for pixels, image in zip(sent, wanted, strict=True):
        np.testing.assert_array_equal(pixels, image)


def test_while_the_cursor_moves_nothing_is_sent(visit: Visit) -> None:
    assert len(KittyTerminal.after(visit["moved"]).images) == 4
    assert visit["moved"].count(b"a=T") == 4


def test_a_screen_above_and_its_end_send_no_picture_again(visit: Visit) -> None:
    assert b"\x1b_G" not in visit["help"]
    assert not placed_cells(visit["help"])
    assert b"\x1b_G" not in visit["back"]


def test_another_size_is_another_box(visit: Visit) -> None:
    boxes = [
        {held.box for held in KittyTerminal.after(visit[part]).images.values()}
        for part in ("moved", "resized")
    ]
    assert boxes[0] != boxes[1]


def test_nothing_is_left_in_the_screen_that_is_left(visit: Visit) -> None:
    assert KittyTerminal.after(visit["all"]).images == {}
    before, _, after = visit["left"].partition(b"\x1b[?1049l")
    assert b"a=d" in before
    assert b"\x1b_G" not in after


async def test_a_terminal_that_draws_none_is_told_so(tiny_store: Path) -> None:
    app = S2RApp(Session(tiny_store), RenderOptions())
    app.load_scheduler.debounce_seconds = 0.001
    enable_inline_images(app, parse_answer(ATTRIBUTES))
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        shown = take_screenshot(app).text
    assert "images are drawn as half blocks" in shown
    assert "▀" in shown
    assert PLACEHOLDER not in shown
    assert app.image_host is None
