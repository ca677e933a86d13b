"""Sixels, iTerm2's images and PNG, decoded by independent decoders."""

from functools import partial
from io import BytesIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image
from rich.console import Console

from bench.support.processes import wait_until
from bench.support.screen import ESCAPE, PATIENCE
from s2rtui.canvas import Canvas, ColourMode, InlineImage, Pixels, Size
from s2rtui.terminal.graphics.drawn_images import SixelImages
from s2rtui.terminal.graphics.inline_images import ImageManager
from s2rtui.terminal.graphics.protocols import Graphics, GraphicsProtocol
from s2rtui.terminal.graphics.reduced_png import MOST, png
from s2rtui.terminal.graphics.sixel import MOST_COLUMNS, PaletteImage, quantised, sixels
from s2rtui.terminal.strips import to_strips
from tests.support.pixel_screen import PixelScreen, decode_sixels
from tests.support.terminals import open_application

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


def test_a_modal_screen_hides_the_images_and_leaving_removes_them(tiny_store, tmp_path):
    options = "--graphics", "sixel", "--cell-size", "10x20"
    screen = open_application(tiny_store, tmp_path, *options, draws=False)

    def shown(raw: bytes | None = None) -> PixelScreen:
        """The pixels after all bytes, or after the sequences that arrived completely."""
        raw = bytes(screen.raw[: screen.raw.rfind(b"\x1b")]) if raw is None else raw
        return PixelScreen((120, 40), CELL).feed(raw)

    def share() -> float:
        """The part of the screen that images cover."""
        return float((shown().pixels >= 0).any(axis=-1).mean())

    assert wait_until(lambda: QUESTION_END in screen.raw, PATIENCE)
    screen.press(SIXEL_ANSWER)
    assert wait_until(lambda: b"any key begins" in screen.raw, PATIENCE)
    screen.press(ESCAPE)
    assert wait_until(lambda: shown().received >= 5, PATIENCE, interval=0.1)
    first = share()
    screen.press("?")
    assert wait_until(lambda: share() < 0.02 < first, PATIENCE, interval=0.1)
    screen.press(ESCAPE)
    assert wait_until(lambda: share() > 0.9 * first, PATIENCE, interval=0.1)
    screen.press("q")
    assert screen.wait_for_end() == 0
    assert (shown(bytes(screen.raw)).pixels == -1).all()
    screen.close()


# --- PNG -----------------------------------------------------------------------------------------


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
