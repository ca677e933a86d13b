"""Inline images: the query to the terminal, strips with placeholders, and transmission."""

import re
import threading
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from textual.strip import Strip

from bench.support.processes import wait_until
from s2rtui.canvas import Canvas, ColourMode, InlineImage, Size
from s2rtui.canvas.colour import Pixels
from s2rtui.terminal.capabilities import Terminal
from s2rtui.terminal.graphics import choice
from s2rtui.terminal.graphics.choice import choose_graphics, parse_answer
from s2rtui.terminal.graphics.inline_images import ImageManager
from s2rtui.terminal.graphics.kitty import MOST_IMAGES
from s2rtui.terminal.graphics.protocols import Graphics
from s2rtui.terminal.graphics.reduced_png import (
    MAX_BYTES,
    MAX_DRAWN_PIXELS,
    MAX_PIXELS,
    reduced_size,
)
from s2rtui.terminal.strips import to_strips
from tests.support.kitty import (
    ANSWER,
    ATTRIBUTES,
    CELL_SIZE,
    CURSOR_REPORT,
    GRAPHICS_OK,
    KittyTerminal,
    placed_cells,
)

TRUECOLOR_TERMINAL = Terminal(ColourMode.TRUECOLOR, False, "")
MOVED_CURSOR_REPORT = b"\x1b[7;2R"
SIXEL_ATTRIBUTES = b"\x1b[?62;4;22c"


def codes(strips: list[Strip]) -> bytes:
    return "".join(strip.render(Console()) for strip in strips).encode()


def noise(size: Size) -> Pixels:
    return np.random.default_rng(1).integers(0, 256, (*size, 3)).astype(np.uint8)


def canvas(pixels: Pixels, box: Size = (6, 3), source: object = None) -> Canvas:
    """An image at (2, 1) surrounded by text."""
    result = Canvas(12, 5)
    for row in range(5):
        result.text(0, row, "abcdefghijkl")
    shape, source = pixels.shape[:2], object() if source is None else source
    result.images.append(InlineImage(2, 1, *box, shape, partial(resized, pixels), source))
    return result


def resized(pixels: Pixels, size: Size) -> Pixels:
    return pixels[: size[0], : size[1]]


class FakeTerminal:
    """An image manager and the text that it writes."""

    def __init__(self, in_tmux: bool = False) -> None:
        self.written = ""
        self.ready_count = 0
        graphics = Graphics("kitty", "", in_tmux=in_tmux)
        self.manager = ImageManager(graphics, self._write, self._ready)

    def _write(self, text: str) -> None:
        self.written += text

    def _ready(self) -> None:
        self.ready_count += 1

    def begin(self, canvas_with_image: Canvas, view: str = "instance") -> list[Strip]:
        return self.manager.attach(
            view, canvas_with_image, to_strips(canvas_with_image, ColourMode.TRUECOLOR)
        ).strips

    def draw(self, canvas_with_image: Canvas, view: str = "instance") -> list[Strip]:
        """The strips after the images have been encoded."""
        strips = self.begin(canvas_with_image, view)
        self.wait()
        return self.begin(canvas_with_image, view) if self.ready_count else strips

    def wait(self) -> None:
        assert wait_until(lambda: self.manager.idle, 20, interval=0.0005)


# --- the query -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("answer", "pictures", "expected"),
    [
        (ANSWER, True, "Kitty"),
        (ATTRIBUTES, False, "does not support"),
        (SIXEL_ATTRIBUTES, True, "sixels"),
        (CURSOR_REPORT + CURSOR_REPORT + CELL_SIZE + ATTRIBUTES, False, "does not support"),
        (
            CURSOR_REPORT + GRAPHICS_OK + MOVED_CURSOR_REPORT + ATTRIBUTES,
            False,
            "not its placeholders",
        ),
        (CURSOR_REPORT + GRAPHICS_OK + MOVED_CURSOR_REPORT + SIXEL_ATTRIBUTES, True, "sixels"),
        (GRAPHICS_OK + ATTRIBUTES, False, "not its placeholders"),
        (CURSOR_REPORT + GRAPHICS_OK + CURSOR_REPORT, False, "did not answer"),
        (b"", False, "did not answer"),
    ],
)
def test_capabilities_follow_from_the_terminal_s_answer(answer, pictures, expected):
    capabilities = parse_answer(answer)
    assert capabilities.supported is pictures
    assert expected in capabilities.reason


def test_the_cell_size_is_taken_from_the_answer():
    assert parse_answer(ANSWER.replace(CELL_SIZE, b"\x1b[6;31;15t")).cell == (15, 31)


@pytest.mark.parametrize(
    ("wanted", "answer", "expected"),
    [
        ("sixel", ANSWER, None),
        ("sixel", ANSWER.replace(ATTRIBUTES, SIXEL_ATTRIBUTES), "sixel"),
        ("kitty", ANSWER.replace(ATTRIBUTES, SIXEL_ATTRIBUTES), "kitty"),
        ("kitty", SIXEL_ATTRIBUTES, None),
        (None, b"\x1b[?64;14;22c", None),
    ],
)
def test_only_the_named_protocol_is_used(wanted, answer, expected):
    assert parse_answer(answer, wanted).protocol == expected


@pytest.mark.parametrize(
    ("answer", "protocol", "expected"),
    [
        ("256,RGB|xterm-kitty kitty(0.42.0)|on", "kitty", "through tmux"),
        ("|xterm-kitty |1", "kitty", "through tmux"),
        ("|xterm-kitty |0", None, "allow-passthrough on"),
        ("|xterm-kitty kitty|off", None, "allow-passthrough on"),
        ("sixel|xterm-kitty kitty|off", "sixel", "by tmux"),
        ("256|xterm-256color |1", None, "kitty or ghostty"),
        ("", None, "did not name"),
    ],
)
def test_tmux_is_queried_for_its_terminal(monkeypatch, answer, protocol, expected):
    monkeypatch.setattr(choice, "_ask_tmux", lambda: answer)
    monkeypatch.setattr(choice, "_has_terminal", lambda: True)
    environment = {"TMUX": "/tmp/tmux,1,0"}
    capabilities = choice.probe_terminal(TRUECOLOR_TERMINAL, None, environment)
    assert (capabilities.protocol, capabilities.in_tmux) == (protocol, protocol is not None)
    assert expected in capabilities.reason
    assert choose_graphics("auto", TRUECOLOR_TERMINAL, None, environment) == capabilities


@pytest.mark.parametrize(
    ("environment", "protocol"),
    [
        ({"TERM": "xterm-kitty"}, "kitty"),
        ({"TERM_PROGRAM": "iTerm.app"}, "iterm2"),
        ({"TERM_PROGRAM": "WezTerm"}, "iterm2"),
        ({"TERM": "foot-extra"}, "sixel"),
        ({"WT_SESSION": "1"}, "sixel"),
        ({"TERM": "xterm-256color"}, None),
        ({"TERM": "xterm-kitty", "SSH_CONNECTION": "1 2 3 4"}, None),
        ({"TERM_PROGRAM": "WezTerm", "SSH_TTY": "/dev/pts/1"}, None),
    ],
)
def test_auto_decides_by_the_environment_and_never_over_ssh(monkeypatch, environment, protocol):
    monkeypatch.setattr(choice, "_ask_terminal", lambda: pytest.fail("asked"))
    chosen = choose_graphics("auto", TRUECOLOR_TERMINAL, None, environment)
    assert chosen.protocol == protocol


def test_a_given_cell_size_is_used():
    environment = {"TERM": "foot"}
    chosen = choose_graphics("auto", TRUECOLOR_TERMINAL, (9, 18), environment)
    assert chosen.cell_now() == (9, 18)


@pytest.mark.parametrize(
    "terminal",
    [replace(TRUECOLOR_TERMINAL, mode=ColourMode.ANSI), replace(TRUECOLOR_TERMINAL, ascii=True)],
)
def test_unsuitable_terminals_are_not_queried(terminal, monkeypatch):
    monkeypatch.setattr(choice, "_ask_terminal", lambda: pytest.fail("asked"))
    monkeypatch.setattr(choice, "_has_terminal", lambda: True)
    assert "256 colours" in choice.probe_terminal(terminal, None, {}).reason
    chosen = choose_graphics("auto", terminal, None, {"TERM": "foot"})
    assert "256 colours" in chosen.reason


# --- strips --------------------------------------------------------------------------------------


@given(st.integers(0, 12), st.integers(0, 12))
def test_a_cropped_strip_shows_its_part_of_the_image(start, end):
    strip = FakeTerminal().draw(canvas(noise((16, 16))))[2].crop(start, end)
    columns = {column for cells in placed_cells(codes([strip])).values() for column, _ in cells}
    assert columns == {position - 2 for position in range(start, end) if 2 <= position < 8}
    assert strip.cell_length == max(0, end - start)


# --- transmission --------------------------------------------------------------------------------


@given(
    st.tuples(st.integers(1, 2000), st.integers(1, 2000)),
    st.tuples(st.integers(1, 200), st.integers(1, 60)),
    st.tuples(st.integers(1, 40), st.integers(1, 80)),
)
def test_the_pixel_size_is_limited_by_image_box_and_maximum(shape, box, cell):
    plate = InlineImage(0, 0, *box, shape, lambda size: noise(size), shape)
    rows, columns = reduced_size(plate, cell)
    assert 1 <= rows <= max(1, min(shape[0], box[1] * cell[1]))
    assert 1 <= columns <= max(1, min(shape[1], box[0] * cell[0]))
    assert rows * columns <= max(MAX_PIXELS, *shape)


def test_drawings_fill_their_box_up_to_a_maximum():
    drawing = InlineImage(0, 0, 60, 30, None, noise, "drawing")
    assert reduced_size(drawing, (9, 19)) == (30 * 19, 60 * 9)
    rows, columns = reduced_size(drawing, (40, 80))
    assert 0.9 * MAX_DRAWN_PIXELS < rows * columns <= MAX_DRAWN_PIXELS
    assert rows == columns


def test_large_images_are_reduced_to_the_byte_limit():
    terminal = FakeTerminal()
    terminal.draw(canvas(noise((256, 256)), (8, 4)))
    assert 0 < KittyTerminal.after(terminal.written.encode()).received <= MAX_BYTES * 4 // 3 + 4


def test_a_displayed_image_is_not_sent_again():
    terminal = FakeTerminal()
    terminal.draw(canvas(noise((16, 16))))
    written_before = terminal.written
    terminal.draw(canvas(noise((16, 16))))
    assert terminal.written == written_before
    terminal.draw(canvas(255 - noise((16, 16))))
    assert terminal.written != written_before


def test_images_are_encoded_in_the_background_and_the_newest_is_shown():
    terminal, released, calls = FakeTerminal(), threading.Event(), []

    def blocking_pixels(shade: int, size: Size) -> Pixels:
        calls.append((shade, threading.current_thread()))
        assert released.wait(10)
        return np.full((*size, 3), shade, np.uint8)

    def canvas_of_shade(shade: int) -> Canvas:
        strips_after = Canvas(12, 5)
        strips_after.images.append(
            InlineImage(2, 1, 6, 3, (4, 4), partial(blocking_pixels, shade), shade)
        )
        return strips_after

    first = terminal.draw(canvas(np.full((4, 4, 3), 9, np.uint8)))
    written_before, shown = terminal.written, placed_cells(codes(first))
    for shade in range(5):
        assert placed_cells(codes(terminal.begin(canvas_of_shade(shade)))) == shown
    assert terminal.written == written_before
    released.set()
    terminal.wait()
    strips_after = terminal.begin(canvas_of_shade(4))
    (number,) = placed_cells(codes(strips_after))
    assert (KittyTerminal.after(terminal.written.encode()).images[number].pixels == 4).all()
    assert len(calls) <= 2
    assert calls[-1][0] == 4
    assert threading.current_thread() not in {thread for _, thread in calls}


def test_images_encoded_after_deletion_are_not_sent():
    terminal, released = FakeTerminal(), threading.Event()
    canvas_with_image = canvas(noise((16, 16)))
    delayed_pixels = partial(lambda pixels, size: released.wait(10) and pixels, noise((16, 16)))
    canvas_with_image.images[0] = replace(canvas_with_image.images[0], pixels=delayed_pixels)
    terminal.begin(canvas_with_image)
    terminal.manager.delete_all()
    released.set()
    terminal.wait()
    assert (terminal.written, terminal.ready_count) == ("", 0)


def test_a_displayed_image_keeps_its_number():
    terminal = FakeTerminal()
    (strip, *_) = terminal.draw(canvas(noise((16, 16))), "instance")[1:]
    shown = set(placed_cells(codes([strip])))
    for shade in range(3 * MOST_IMAGES):
        canvas_with_image = canvas(np.full((4, 4, 3), shade, np.uint8))
        assert not shown & set(placed_cells(codes(terminal.draw(canvas_with_image, "adjust"))))
    assert len(KittyTerminal.after(terminal.written.encode()).images) <= MOST_IMAGES


def test_every_sequence_is_wrapped_for_tmux():
    terminal = FakeTerminal(in_tmux=True)
    terminal.draw(canvas(noise((64, 64)), (10, 3)))
    terminal.manager.delete_all()
    parts = re.findall(r"\x1bPtmux;((?:\x1b\x1b|[^\x1b])*)\x1b\\", terminal.written)
    assert "".join(f"\x1bPtmux;{part}\x1b\\" for part in parts) == terminal.written
    passed_through = "".join(parts).replace("\x1b\x1b", "\x1b").encode()
    assert passed_through.count(b"a=T") == 1
    assert KittyTerminal.after(passed_through).received > 4096
