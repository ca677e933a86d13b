"""Sixels, iTerm2's images and PNG, decoded by independent decoders."""

import asyncio
import sys
import time
from collections.abc import Callable, Iterator
from copy import deepcopy
from functools import partial
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image
from rich.console import Console

from bench.support.processes import wait_until
from bench.support.screen import RIGHT, Screen
from s2rtui.canvas import Canvas, ColourMode, InlineImage, Pixels, RenderOptions, Size
from s2rtui.charts.registry import BY_NAME
from s2rtui.terminal.graphics.drawn_images import SixelImages
from s2rtui.terminal.graphics.image_manager import ImageManager
from s2rtui.terminal.graphics.png import MOST, png
from s2rtui.terminal.graphics.protocols import Graphics, GraphicsProtocol
from s2rtui.terminal.graphics.sixel import MOST_COLUMNS, PaletteImage, quantised, sixels
from s2rtui.terminal.strips import to_strips
from tests.support.application import running
from tests.support.pixel_screen import PixelScreen, decode_sixels

CELL = (10, 20)
SIXEL_ANSWER = b"\x1b[?62;4;22c"
QUESTION_END = b"\x1b[c"


def noise(size: Size, colours: int = 256, seed: int = 1) -> Pixels:
    rng = np.random.default_rng(seed)
    palette = rng.integers(0, 256, (colours, 3)).astype(np.uint8)
    return palette[rng.integers(0, colours, size)]


def decoded(image: PaletteImage) -> NDArray[np.int16]:
    written = sixels(image)
    assert written.startswith("\x1bP")
    assert written.endswith("\x1b\\")
    return decode_sixels(written[2:-2])


# --- sixels --------------------------------------------------------------------------------------


@given(st.integers(1, 40), st.integers(1, 60), st.integers(1, 600), st.integers(0, 9))
def test_decoded_sixels_equal_the_quantised_image(rows, columns, colours, seed):
    reduced = quantised(noise((rows, columns), colours, seed))
    np.testing.assert_array_equal(decoded(reduced), reduced.pixels)


@pytest.mark.parametrize("length", [1, 2, 3, 4, 9, 10, 99, 100, 999, 1000, MOST_COLUMNS])
def test_runs_of_every_length_are_decoded(length):
    row = np.zeros((6, length, 3), dtype=np.uint8)
    row[2, -1] = 255
    reduced = quantised(row)
    np.testing.assert_array_equal(decoded(reduced), row)


@given(st.integers(1, 256), st.integers(0, 9))
def test_up_to_256_colours_change_by_the_rounding_to_percent_alone(colours, seed):
    image = noise((20, 30), colours, seed)
    assert np.abs(quantised(image).pixels.astype(int) - image).max() <= 2


def test_the_error_of_many_colours_is_bounded():
    rows, columns = np.mgrid[0:240, 0:320]
    waves = [
        128 + 100 * np.sin(rows / 40 + at) * np.cos(columns / (30 + 9 * at)) for at in range(3)
    ]
    image = np.rint(np.stack(waves, axis=-1)).astype(np.uint8)
    error = np.abs(quantised(image).pixels.astype(int) - image)
    assert error.mean() < 7
    assert np.percentile(error, 99) < 24


@pytest.mark.parametrize("shape", [(0, 3, 3), (3, 0, 3), (6, MOST_COLUMNS + 1, 3)])
def test_images_that_sixels_cannot_hold_are_refused(shape):
    with pytest.raises(ValueError, match="cannot be drawn"):
        sixels(quantised(np.zeros(shape, dtype=np.uint8)))


# --- images over cells ---------------------------------------------------------------------------


class FakeTerminal:
    """An image manager whose strips are drawn on a pixel screen of 12 x 5 cells."""

    def __init__(self, protocol: GraphicsProtocol) -> None:
        graphics = Graphics(protocol, "", CELL, is_cell_fixed=True)
        self.manager = ImageManager(graphics, lambda text: None, lambda: None, rest=0.0)
        self.screen = PixelScreen((12, 5), CELL)

    def draw(self, canvas: Canvas) -> None:
        """Draw all rows once the images are encoded."""
        strips = to_strips(canvas, ColourMode.TRUECOLOR)
        self.manager.attach("map", canvas, strips)
        assert wait_until(lambda: self.manager.idle, 20, interval=0.0005)
        painted = self.manager.attach("map", canvas, strips).strips
        for row, strip in enumerate(painted):
            written = f"\x1b[{row + 1};1H{strip.render(Console())}"
            self.screen.feed(written.encode())


def canvas_with_drawing(text: NDArray[np.bool_] | None = None, seed: int = 1) -> Canvas:
    """A drawing of 6 x 3 cells at (2, 1) in text."""
    canvas = Canvas(12, 5)
    for row in range(5):
        canvas.text(0, row, "abcdefghijkl")
    pixels = partial(noise, seed=seed)
    canvas.images.append(InlineImage(2, 1, 6, 3, None, pixels, seed, text))
    return canvas


def expected(seed: int = 1) -> NDArray[np.int16]:
    picture = noise((60, 60), seed=seed)
    return quantised(picture).pixels.astype(np.int16)


@pytest.mark.parametrize("protocol", ["sixel", "iterm2"])
def test_the_box_shows_exactly_the_newest_image_around_its_text(protocol):
    text = np.zeros((3, 6), dtype=np.bool_)
    text[0, :2] = text[1, 2:4] = text[2, 5] = True
    terminal = FakeTerminal(protocol)
    terminal.draw(canvas_with_drawing(text))
    covered = np.repeat(np.repeat(text, CELL[1], axis=0), CELL[0], axis=1)
    wanted = np.where(covered[..., None], -1, expected())
    np.testing.assert_array_equal(terminal.screen.box(2, 1, 6, 3), wanted)
    terminal.draw(canvas_with_drawing(seed=2))
    np.testing.assert_array_equal(terminal.screen.box(2, 1, 6, 3), expected(2))
    terminal.screen.box(2, 1, 6, 3)[:] = -1
    assert (terminal.screen.pixels == -1).all()


def test_the_last_rows_that_fill_no_band_are_left_out():
    terminal = FakeTerminal("sixel")
    canvas = canvas_with_drawing()
    canvas.images[0] = InlineImage(2, 1, 6, 1, None, noise, "low")
    terminal.draw(canvas)
    box = terminal.screen.box(2, 1, 6, 1)
    assert (box[:18] >= 0).all()
    assert (box[18:] == -1).all()


def test_an_image_over_a_huge_screen_stays_in_cells():
    image = InlineImage(0, 0, 1000, 500, None, noise, "huge")
    assert not SixelImages().fits(image)


def test_columns_that_sixels_cannot_count_are_left_out():
    image = InlineImage(0, 0, 1000, 1, None, noise, "wide")
    written = SixelImages().encode(image, (20, 10_000)).decode()
    assert decode_sixels(written[2:-2]).shape == (18, MOST_COLUMNS, 3)


# --- the application -----------------------------------------------------------------------------


def open_application(store: Path, share: Path, protocol: str) -> Screen:
    environment = {
        "XDG_DATA_HOME": str(share),
        "PYTHONPATH": ":".join(path for path in sys.path if path),
        "COLORTERM": "truecolor",
        "OMP_NUM_THREADS": "1",
    }
    options = ["--graphics", protocol, "--cell-size", "10x20"]
    command = [sys.executable, "-m", "s2rtui", "tui", str(store), *options]
    return Screen(command, (120, 40), environment, draws=False)


Boxes = tuple[Size, Size, NDArray[np.int16]]
"""Position and size of the map in cells, and its picture."""


@pytest.fixture(scope="module")
def first_map(tiny_store: Path) -> Boxes:
    """The map of the first screen as its view paints it."""

    async def read() -> Boxes:
        async with running(tiny_store) as (app, _pilot):
            region = app.updater.plot("map").region
            size = region.width, region.height - 1
            canvas = BY_NAME["map"].draw(app.updater.scene, size, RenderOptions())
            (image,) = canvas.images
            place = region.x + image.x, region.y + 1 + image.y
            pixels = image.pixels((image.height * CELL[1], image.width * CELL[0]))
            covered = np.zeros(pixels.shape[:2], dtype=np.bool_)
            if image.text is not None:
                covered = np.repeat(np.repeat(image.text, CELL[1], axis=0), CELL[0], axis=1)
            shown = quantised(pixels[: len(pixels) // 6 * 6]).pixels.astype(np.int16)
            full = np.full(pixels.shape, -1, dtype=np.int16)
            full[: len(shown)] = shown
            full[covered] = -1
            return place, (image.width, image.height), full

    return asyncio.run(read())


Visit = dict[str, PixelScreen]


@pytest.fixture(scope="module")
def visit(tiny_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Visit]:
    """The pixels on the screen after each step of a session."""
    screen = open_application(tiny_store, tmp_path_factory.mktemp("sixel"), "sixel")
    shown: Visit = {}

    pixels, fed = PixelScreen((120, 40), CELL), 0

    def wait(condition: Callable[[PixelScreen, bytes], bool]) -> PixelScreen:
        nonlocal fed
        limit, before = time.monotonic() + 30, -1
        while True:
            raw = bytes(screen.raw)
            if len(raw) == before:  # nothing arrived meanwhile, so no sequence is cut
                pixels.feed(raw[fed:])
                fed = len(raw)
                if condition(pixels, raw):
                    return deepcopy(pixels)
            assert time.monotonic() < limit, raw[-300:]
            before = len(raw)
            time.sleep(0.3)

    wait(lambda pixels, raw: QUESTION_END in raw)
    screen.press(SIXEL_ANSWER)
    wait(lambda pixels, raw: b"any key begins" in raw)
    screen.press(b"\x1b")
    shown["first"] = wait(lambda pixels, raw: pixels.received >= 5)
    screen.press("?")
    shown["help"] = wait(lambda pixels, raw: raw.count(b"straight driving") > 0)
    screen.press(b"\x1b")
    shown["back"] = wait(lambda pixels, raw: pixels.received > shown["help"].received)
    screen.press(RIGHT)
    shown["moved"] = wait(lambda pixels, raw: pixels.received >= shown["back"].received + 5)
    screen.press("9")
    shown["compare"] = wait(lambda pixels, raw: pixels.received > shown["moved"].received)
    screen.press("q")
    assert screen.wait_for_end() == 0
    shown["left"] = pixels.feed(bytes(screen.raw)[fed:])
    yield shown
    screen.close()


def test_the_map_on_the_screen_equals_the_picture(visit, first_map):
    place, size, picture = first_map
    np.testing.assert_array_equal(visit["first"].box(*place, *size), picture)


def test_a_modal_screen_hides_the_images_and_they_return(visit):
    hidden = (visit["help"].pixels >= 0).any(axis=-1).mean()
    assert hidden < 0.02 < (visit["first"].pixels >= 0).any(axis=-1).mean()
    np.testing.assert_array_equal(visit["back"].pixels, visit["first"].pixels)


def test_images_follow_the_cursor(visit, first_map):
    place, size, picture = first_map
    moved = visit["moved"].box(*place, *size)
    assert (moved != picture).any()
    assert (moved >= 0).mean() > 0.8


def test_leaving_the_application_removes_all_images(visit):
    assert (visit["left"].pixels == -1).all()


def decode(data: bytes) -> Pixels:
    return np.asarray(Image.open(BytesIO(data)).convert("RGB"))


@given(st.integers(1, 40), st.integers(1, 40), st.integers(1, 400), st.integers(0, 9))
def test_encoding_is_lossless(rows, columns, colours, seed):
    rng = np.random.default_rng(seed)
    palette = rng.integers(0, 256, (colours, 3)).astype(np.uint8)
    pixels = palette[rng.integers(0, colours, (rows, columns))]
    np.testing.assert_array_equal(decode(png(pixels)), pixels)


@pytest.mark.parametrize("colours", [MOST, MOST + 1])
def test_a_palette_is_used_up_to_its_number_of_colours(colours):
    codes = np.arange(colours)
    pixels = np.stack([codes % 251, codes // 251, codes * 0], axis=1).astype(np.uint8)[None]
    image = Image.open(BytesIO(png(pixels)))
    assert image.mode == ("P" if colours == MOST else "RGB")
    np.testing.assert_array_equal(decode(png(pixels)), pixels)
