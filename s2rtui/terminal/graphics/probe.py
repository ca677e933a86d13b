"""Ask the terminal, once before the application starts, whether it draws inline images.

Every terminal answers the last question (its attributes, DA1), so support is never guessed from a
timeout: a slow connection only takes longer.
"""

from __future__ import annotations

import fcntl
import os
import re
import select
import struct
import subprocess
import sys
import termios
import time
import tty
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

from s2rtui.canvas import RenderOptions, Size
from s2rtui.terminal.capabilities import Terminal
from s2rtui.terminal.graphics import kitty_protocol

PATIENCE = 3.0
"""Seconds to wait for the answer."""
USUAL_CELL = (10, 20)
_NUMBER = 31
_ATTRIBUTES = re.compile(rb"\x1b\[\?[\d;]*c")
_CURSOR = re.compile(rb"\x1b\[\d+;\d+R")
_CELL = re.compile(rb"\x1b\[6;(\d+);(\d+)t")
_DRAWN = b"\x1b_Gi=%d;OK" % _NUMBER
_ON_TMUX = re.compile("kitty|ghostty")


@dataclass(frozen=True, slots=True)
class Graphics:
    """Whether the terminal draws images, why, and its cell size (width, height) in pixels."""

    supported: bool
    reason: str
    cell: Size = USUAL_CELL
    in_tmux: bool = False


def probe_terminal(terminal: Terminal, environment: Mapping[str, str] | None = None) -> Graphics:
    """Ask the terminal, or tmux about its terminal."""
    env = os.environ if environment is None else environment
    if terminal.ascii or not RenderOptions(mode=terminal.mode).supports_shading:
        return Graphics(False, "inline images need 256 colours or more, and UTF-8")
    if not _has_terminal():
        return Graphics(False, "no terminal")
    if env.get("TMUX"):
        return _parse_tmux_answer(_ask_tmux())
    return parse_answer(_ask_terminal())


def _has_terminal() -> bool:
    return sys.stdin.isatty() and sys.stdout.isatty()


def parse_answer(answer: bytes) -> Graphics:
    """Interpret the answers to `_question`."""
    if not _ATTRIBUTES.search(answer):
        return Graphics(False, f"the terminal did not answer within {PATIENCE:.0f} s")
    if _DRAWN not in answer:
        return Graphics(False, "the terminal does not support the Kitty graphics protocol")
    if len(set(_CURSOR.findall(answer))) != 1:
        reason = "the terminal supports the Kitty graphics protocol, but not its placeholders"
        return Graphics(False, reason)
    cell = _CELL.search(answer)
    size = (int(cell[2]), int(cell[1])) if cell else USUAL_CELL
    return Graphics(True, "Kitty graphics protocol", cell_pixels(size))


def cell_pixels(otherwise: Size = USUAL_CELL) -> Size:
    """(width, height) of a cell in pixels, or `otherwise` if the system does not know it."""
    with suppress(OSError, ValueError, AttributeError):
        size = fcntl.ioctl(sys.__stdout__.fileno(), termios.TIOCGWINSZ, bytes(8))  # type: ignore[union-attr]
        rows, columns, width, height = struct.unpack("HHHH", size)
        if rows and columns and width >= columns and height >= rows:
            return width // columns, height // rows
    return otherwise


def _question() -> bytes:
    """Send and delete one pixel, and ask for the cell size and the terminal's attributes.

    A terminal without placeholders shows the pixel at once, which moves the cursor.
    """
    pixel = kitty_protocol.command(f"a=T,U=1,i={_NUMBER},c=1,r=1,s=1,v=1,f=24,t=d;AAAA")
    return f"\x1b[6n{pixel}\x1b[6n{kitty_protocol.forget([_NUMBER])}\x1b[16t\x1b[c".encode()


def _ask_terminal() -> bytes:
    """Read the answer up to the attributes; keys pressed meanwhile are lost."""
    source = sys.stdin.fileno()
    before = termios.tcgetattr(source)
    answer = b""
    try:
        tty.setcbreak(source, termios.TCSANOW)
        os.write(sys.stdout.fileno(), _question())
        limit = time.monotonic() + PATIENCE
        while not _ATTRIBUTES.search(answer):
            left = limit - time.monotonic()
            if left <= 0 or not select.select([source], [], [], left)[0]:
                break
            piece = os.read(source, 4096)
            if not piece:
                break
            answer += piece
    finally:
        termios.tcsetattr(source, termios.TCSANOW, before)
    return answer


def _ask_tmux() -> str:
    """The terminal that tmux runs in and its passthrough option; empty if tmux does not answer."""
    variables = "#{client_termname} #{client_termtype} #{allow-passthrough}"
    command = ["tmux", "display-message", "-p", variables]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=True)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout


def _parse_tmux_answer(answer: str) -> Graphics:
    if not answer.strip():
        return Graphics(False, "tmux did not name its terminal")
    if not _ON_TMUX.search(answer.lower()):
        return Graphics(False, "inside tmux, inline images need kitty or ghostty as its terminal")
    if answer.split()[-1] in ("0", "off"):
        return Graphics(False, "tmux blocks inline images; run `tmux set -g allow-passthrough on`")
    return Graphics(True, "Kitty graphics protocol through tmux", cell_pixels(), in_tmux=True)
