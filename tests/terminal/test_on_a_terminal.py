"""Inline images over a pseudo-terminal that answers like kitty."""

import asyncio
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from bench.support.screen import PATIENCE, RIGHT, Screen
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.app.runner import enable_inline_images
from s2rtui.canvas.colour import DEPTH_SHADES
from s2rtui.charts.shared.instance import InstanceInput, instance_drawing
from s2rtui.terminal.graphics.choice import parse_answer
from s2rtui.terminal.graphics.kitty import PLACEHOLDER
from tests.support.application import make_app, running
from tests.support.kitty import (
    ANSWER,
    ATTRIBUTES,
    QUESTION_END,
    KittyTerminal,
    ReceivedImage,
    box_cells,
    placed_cells,
)
from tests.support.terminals import open_application

Visit = dict[str, bytes]
IMAGES = 5
"""The map, and RGB and depth of both sides."""


def wait_until_received(screen: Screen, condition: Callable[[bytes], bool]) -> None:
    limit = time.monotonic() + PATIENCE
    while not condition(bytes(screen.raw)):
        assert time.monotonic() < limit, bytes(screen.raw)[-400:]
        time.sleep(0.01)


def answer_query(screen: Screen, answer: bytes) -> None:
    wait_until_received(screen, lambda raw: QUESTION_END in raw)
    screen.press(answer)


def skip_tour(screen: Screen) -> None:
    screen.wait_for("any key begins")
    screen.press(b"\x1b")


@pytest.fixture(scope="module")
def first_instance(tiny_store: Path) -> InstanceInput:
    """The instance input of the first screen."""

    async def read() -> InstanceInput:
        async with running(tiny_store) as (app, _pilot):
            assert app.loaded.pictures is not None
            return app.loaded.pictures

    return asyncio.run(read())


@pytest.fixture(scope="module")
def visit(
    tiny_store: Path, first_instance: InstanceInput, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Visit]:
    """The bytes received after each step of a session."""
    screen = open_application(
        tiny_store, tmp_path_factory.mktemp("graphics"), "--graphics", "kitty"
    )
    parts: Visit = {}
    offset = 0

    def part(name: str, condition: Callable[[bytes], bool]) -> None:
        nonlocal offset
        wait_until_received(screen, lambda raw: condition(raw[offset:]))
        parts[name], offset = bytes(screen.raw[offset:]), len(screen.raw)

    answer_query(screen, ANSWER)
    part("asked", lambda raw: True)
    skip_tour(screen)
    part("first", lambda raw: len(placed_cells(raw)) == IMAGES and all_images_complete(raw))
    screen.press(5 * RIGHT)  # in one piece, so that the load does not spread them
    with s2rstore.open(tiny_store) as store:
        moved = (first_instance.iid + 5) % len(store.instances)
    screen.wait_for(f"instance  {moved},", 20)
    part(
        "moved",
        lambda raw: len(KittyTerminal.after(raw).images) == IMAGES and all_images_complete(raw),
    )
    screen.press("?")
    part("help", lambda raw: b"straight driving" in raw)
    screen.press(b"\x1b")
    part("back", lambda raw: all_images_complete(raw, KittyTerminal.after(parts["moved"]).images))
    screen.resize(110, 36)
    part(
        "resized",
        lambda raw: len(KittyTerminal.after(raw).images) == IMAGES and all_images_complete(raw),
    )
    screen.press("q")
    assert screen.wait_for_end() == 0
    parts["left"], parts["all"] = bytes(screen.raw[offset:]), bytes(screen.raw)
    yield parts
    screen.close()


def all_images_complete(raw: bytes, images: dict[int, ReceivedImage] | None = None) -> bool:
    """Whether every image is placed with all its cells, the map with most of them.

    Names of rooms lie on the map as text. Without `images`, the transmitted ones count.
    """
    images, cells = images or KittyTerminal.after(raw).images, placed_cells(raw)
    boxes = {number: box_cells(*image.box) for number, image in images.items()}
    placed = {number: cells.get(number, set()) for number in images}
    return bool(images) and all(
        placed[number] == box or (number == max(boxes, key=lambda at: len(boxes[at]))
                                  and placed[number] <= box
                                  and len(placed[number]) > 0.8 * len(box))
        for number, box in boxes.items()
    )  # fmt: skip


def test_transmitted_images_are_exact(visit, first_instance):
    images = KittyTerminal.after(visit["first"]).images.values()
    sent = [image.pixels for image in images if image.pixels.shape == (16, 16, 3)]
    expected = [
        plot.image.pixels((16, 16), DEPTH_SHADES)
        for plot in instance_drawing(first_instance).plots
        if plot.image is not None
    ]
    assert len(sent) == len(expected)
    for pixels, image in zip(sent, expected, strict=True):
        np.testing.assert_array_equal(pixels, image)


def test_intermediate_images_are_not_sent(visit):
    assert len(KittyTerminal.after(visit["moved"]).images) == IMAGES
    assert visit["moved"].count(b"a=T") == IMAGES


def test_modal_screens_send_no_images(visit):
    assert b"\x1b_G" not in visit["help"]
    assert not placed_cells(visit["help"])
    assert b"\x1b_G" not in visit["back"]


def test_resizing_changes_the_image_boxes(visit):
    boxes = [
        {images.box for images in KittyTerminal.after(visit[part]).images.values()}
        for part in ("moved", "resized")
    ]
    assert boxes[0] != boxes[1]


def test_images_are_deleted_before_leaving_the_screen(visit):
    assert KittyTerminal.after(visit["all"]).images == {}
    before, _, after = visit["left"].partition(b"\x1b[?1049l")
    assert b"a=d" in before
    assert b"\x1b_G" not in after


async def test_a_terminal_without_graphics_shows_half_blocks(tiny_store):
    app = make_app(tiny_store)
    enable_inline_images(app, parse_answer(ATTRIBUTES))
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        shown = take_screenshot(app).text
    assert "images are drawn in cells" in shown
    assert "▀" in shown
    assert PLACEHOLDER not in shown
    assert app.image_host is None
