"""The question to the terminal, strips with pictures, and what is sent of a picture."""

from __future__ import annotations

import re
import threading
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console
from textual.strip import Strip

from s2rtui.canvas import Canvas, ColourMode, InlineImage, Size
from s2rtui.canvas.colour import Pixels
from s2rtui.cli import main
from s2rtui.terminal.capabilities import Terminal
from s2rtui.terminal.graphics import kitty_protocol, probe
from s2rtui.terminal.graphics.image_manager import (
    MAX_BYTES,
    MAX_PIXELS,
    NUMBERS,
    KittyImageManager,
    pixel_size,
)
from s2rtui.terminal.graphics.probe import Graphics, parse_answer
from s2rtui.terminal.strips import to_strips
from tests.support.kitty import (
    ANSWER,
    ATTRIBUTES,
    CELL_SIZE,
    CURSOR_REPORT,
    GRAPHICS_OK,
    KittyTerminal,
    box_cells,
    placed_cells,
)

TRUE = Terminal(ColourMode.TRUECOLOR, False, "")
MOVED = b"\x1b[7;2R"


def codes(strips: list[Strip]) -> bytes:
    return "".join(strip.render(Console()) for strip in strips).encode()


def noise(size: Size) -> Pixels:
    return np.random.default_rng(1).integers(0, 256, (*size, 3)).astype(np.uint8)


def canvas(pixels: Pixels, box: Size = (6, 3), of: object = None) -> Canvas:
    """A picture at (2, 1), text on all sides of it."""
    drawn = Canvas(12, 5)
    for row in range(5):
        drawn.text(0, row, "abcdefghijkl")
    shape, of = pixels.shape[:2], object() if of is None else of
    drawn.images.append(InlineImage(2, 1, *box, shape, partial(resized, pixels), of))
    return drawn


def resized(pixels: Pixels, size: Size) -> Pixels:
    return pixels[: size[0], : size[1]]


class Terminals:
    """A wall, and what it wrote."""

    def __init__(self, in_tmux: bool = False) -> None:
        self.written = ""
        self.made = 0
        graphics = Graphics(True, "", in_tmux=in_tmux)
        self.wall = KittyImageManager(graphics, self._write, self._ready)

    def _write(self, text: str) -> None:
        self.written += text

    def _ready(self) -> None:
        self.made += 1

    def begin(self, drawn: Canvas, view: str = "instance") -> list[Strip]:
        return self.wall.attach(view, drawn, to_strips(drawn, ColourMode.TRUECOLOR)).strips

    def hang(self, drawn: Canvas, view: str = "instance") -> list[Strip]:
        """As it is once the pictures are made."""
        strips = self.begin(drawn, view)
        self.wait()
        return self.begin(drawn, view) if self.made else strips

    def wait(self) -> None:
        limit = time.monotonic() + 20
        while not self.wall.idle:
            assert time.monotonic() < limit
            time.sleep(0.0005)


# --- the question --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("answer", "pictures", "told"),
    [
        (ANSWER, True, "Kitty"),
        (b"typed" + ANSWER, True, "Kitty"),
        (ATTRIBUTES, False, "does not draw"),
        (CURSOR_REPORT + CURSOR_REPORT + CELL_SIZE + ATTRIBUTES, False, "does not draw"),
        (CURSOR_REPORT + GRAPHICS_OK + MOVED + ATTRIBUTES, False, "not its placeholders"),
        (GRAPHICS_OK + ATTRIBUTES, False, "not its placeholders"),
        (CURSOR_REPORT + GRAPHICS_OK + CURSOR_REPORT, False, "did not answer"),
        (b"", False, "did not answer"),
    ],
)
def test_the_terminal_says_itself_what_it_draws(answer: bytes, pictures: bool, told: str) -> None:
    found = parse_answer(answer)
    assert found.pictures is pictures
    assert told in found.told


def test_the_size_of_a_cell_is_the_terminals() -> None:
    assert parse_answer(ANSWER.replace(CELL_SIZE, b"\x1b[6;31;15t")).cell == (15, 31)


@pytest.mark.parametrize(
    ("answer", "pictures", "told"),
    [
        ("xterm-kitty kitty(0.42.0) on\n", True, "passed on"),
        ("xterm-256color ghostty 1.2 all\n", True, "passed on"),
        ("xterm-kitty  1\n", True, "passed on"),
        ("xterm-kitty  0\n", False, "allow-passthrough on"),
        ("xterm-kitty kitty off\n", False, "allow-passthrough on"),
        ("xterm-256color  1\n", False, "kitty or ghostty"),
        ("", False, "does not tell"),
    ],
)
def test_tmux_is_asked_for_its_terminal(
    monkeypatch: pytest.MonkeyPatch, answer: str, pictures: bool, told: str
) -> None:
    monkeypatch.setattr(probe, "_ask_tmux", lambda: answer)
    monkeypatch.setattr(probe, "_here", lambda: True)
    found = probe.probe_terminal(TRUE, {"TMUX": "/tmp/tmux,1,0"})
    assert (found.pictures, found.in_tmux) == (pictures, pictures)
    assert told in found.told


@pytest.mark.parametrize(
    "terminal", [replace(TRUE, mode=ColourMode.ANSI), replace(TRUE, ascii=True)]
)
def test_nothing_is_asked_where_no_picture_can_be(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(probe, "_ask_terminal", lambda: pytest.fail("asked"))
    monkeypatch.setattr(probe, "_here", lambda: True)
    assert "256 colours" in probe.probe_terminal(terminal, {}).told


def test_ascii_and_pictures_exclude_each_other(
    tiny_store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["tui", str(tiny_store), "--graphics", "--ascii"]) == 2
    assert "--ascii" in capsys.readouterr().err


# --- strips --------------------------------------------------------------------------------------


def test_placeholders_cover_the_box_and_no_other_cell() -> None:
    terminal = Terminals()
    strips = terminal.hang(canvas(noise((16, 16))))
    written = codes(strips)
    (number,) = KittyTerminal.after(terminal.written.encode()).images
    assert placed_cells(written) == {number: box_cells(6, 3)}
    text = re.sub(r"\x1b\[[\d;]*m", "", written.decode())
    plain = re.sub(f"{kitty_protocol.PLACEHOLDER}...", "_", text)
    assert plain == "abcdefghijkl" + 3 * "ab______ijkl" + "abcdefghijkl"


@settings(deadline=None)
@given(st.integers(0, 12), st.integers(0, 12))
def test_a_part_of_a_strip_shows_its_part_of_the_picture(start: int, end: int) -> None:
    strip = Terminals().hang(canvas(noise((16, 16))))[2].crop(start, end)
    columns = {column for cells in placed_cells(codes([strip])).values() for column, _ in cells}
    assert columns == {at - 2 for at in range(start, end) if 2 <= at < 8}
    assert strip.cell_length == max(0, end - start)


def test_restyled_strips_are_half_blocks_again() -> None:
    strip = Terminals().hang(canvas(noise((16, 16))))[2]
    assert strip.text == "abcdefghijkl"
    assert not placed_cells(codes([Strip(list(strip))]))


# --- what is sent --------------------------------------------------------------------------------


@settings(deadline=None)
@given(
    st.tuples(st.integers(1, 2000), st.integers(1, 2000)),
    st.tuples(st.integers(1, 200), st.integers(1, 60)),
    st.tuples(st.integers(1, 40), st.integers(1, 80)),
)
def test_never_more_pixels_than_the_picture_the_box_and_the_limit(
    shape: Size, box: Size, cell: Size
) -> None:
    plate = InlineImage(0, 0, *box, shape, lambda size: noise(size), shape)
    rows, columns = pixel_size(plate, cell)
    assert 1 <= rows <= max(1, min(shape[0], box[1] * cell[1]))
    assert 1 <= columns <= max(1, min(shape[1], box[0] * cell[0]))
    assert rows * columns <= max(MAX_PIXELS, *shape)


def test_the_heaviest_picture_is_made_lighter() -> None:
    terminal = Terminals()
    terminal.hang(canvas(noise((256, 256)), (8, 4)))
    assert 0 < KittyTerminal.after(terminal.written.encode()).received <= MAX_BYTES * 4 // 3 + 4


def test_what_hangs_there_is_not_sent_again() -> None:
    terminal = Terminals()
    terminal.hang(canvas(noise((16, 16))))
    before = terminal.written
    terminal.hang(canvas(noise((16, 16))))
    assert terminal.written == before
    terminal.hang(canvas(255 - noise((16, 16))))
    assert terminal.written != before


def test_pictures_are_made_elsewhere_and_the_newest_wins() -> None:
    terminal, opened, makers = Terminals(), threading.Event(), []

    def slow(shade: int, size: Size) -> Pixels:
        makers.append((shade, threading.current_thread()))
        assert opened.wait(10)
        return np.full((*size, 3), shade, np.uint8)

    def drawn(shade: int) -> Canvas:
        made = Canvas(12, 5)
        made.images.append(InlineImage(2, 1, 6, 3, (4, 4), partial(slow, shade), shade))
        return made

    first = terminal.hang(canvas(np.full((4, 4, 3), 9, np.uint8)))
    before, shown = terminal.written, placed_cells(codes(first))
    for shade in range(5):
        assert placed_cells(codes(terminal.begin(drawn(shade)))) == shown
    assert terminal.written == before
    opened.set()
    terminal.wait()
    made = terminal.begin(drawn(4))
    (number,) = placed_cells(codes(made))
    assert (KittyTerminal.after(terminal.written.encode()).images[number].pixels == 4).all()
    assert {shade for shade, _ in makers} <= {0, 4}
    assert threading.current_thread() not in {thread for _, thread in makers}


def test_what_is_made_after_all_were_deleted_is_not_sent() -> None:
    terminal, opened = Terminals(), threading.Event()
    drawn = canvas(noise((16, 16)))
    late = partial(lambda pixels, size: opened.wait(10) and pixels, noise((16, 16)))
    drawn.images[0] = replace(drawn.images[0], pixels=late)
    terminal.begin(drawn)
    terminal.wall.delete_all()
    opened.set()
    terminal.wait()
    assert (terminal.written, terminal.made) == ("", 0)


def test_what_follows_from_the_same_is_not_even_made_again(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminals()
    terminal.hang(canvas(noise((16, 16)), of="one"))
    before = terminal.written
    monkeypatch.setitem(globals(), "resized", lambda pixels, size: pytest.fail("made again"))
    terminal.hang(canvas(noise((16, 16)), of="one"))
    assert terminal.written == before


def test_programs_in_the_panes_of_one_terminal_take_different_numbers() -> None:
    firsts = set()
    for _ in range(20):
        terminal = Terminals()
        terminal.hang(canvas(noise((16, 16))))
        firsts |= set(KittyTerminal.after(terminal.written.encode()).images)
    assert len(firsts) > 10


def test_a_picture_that_is_shown_keeps_its_number() -> None:
    terminal = Terminals()
    (strip, *_) = terminal.hang(canvas(noise((16, 16))), "instance")[1:]
    shown = set(placed_cells(codes([strip])))
    for shade in range(3 * NUMBERS):
        drawn = canvas(np.full((4, 4, 3), shade, np.uint8))
        assert not shown & set(placed_cells(codes(terminal.hang(drawn, "adjust"))))
    assert len(KittyTerminal.after(terminal.written.encode()).images) <= NUMBERS


def test_all_are_deleted() -> None:
    terminal = Terminals()
    for shade in range(5):
        terminal.hang(canvas(np.full((4, 4, 3), shade, np.uint8)))
    terminal.wall.delete_all()
    assert KittyTerminal.after(terminal.written.encode()).images == {}


def test_tmux_passes_every_sequence_on() -> None:
    terminal = Terminals(in_tmux=True)
    terminal.hang(canvas(noise((64, 64)), (10, 3)))
    terminal.wall.delete_all()
    parts = re.findall(r"\x1bPtmux;((?:\x1b\x1b|[^\x1b])*)\x1b\\", terminal.written)
    assert "".join(f"\x1bPtmux;{part}\x1b\\" for part in parts) == terminal.written
    passed = "".join(parts).replace("\x1b\x1b", "\x1b").encode()
    assert passed.count(b"a=T") == 1
    assert KittyTerminal.after(passed).received > 4096
