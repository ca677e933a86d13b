"""How the terminal draws inline images: by option, by environment variables, or by a question.

The question is asked once before the application starts. Every terminal answers its last part (its
attributes, DA1), so support is never guessed from a timeout: a slow connection only takes longer.
"""

from __future__ import annotations

import os
import re
import select
import subprocess
import sys
import termios
import time
import tty
from collections.abc import Mapping
from typing import get_args

from s2rtui.canvas import RenderOptions, Size
from s2rtui.terminal.capabilities import Terminal
from s2rtui.terminal.graphics import kitty
from s2rtui.terminal.graphics.protocols import (
    NAMES,
    USUAL_CELL,
    Graphics,
    GraphicsProtocol,
    cell_pixels,
)

_SSH = ("SSH_CONNECTION", "SSH_CLIENT", "SSH_TTY")
_SIXEL_PROGRAMS = ("vscode", "mintty", "contour", "BlackBox")
"""Values of TERM_PROGRAM of terminals that draw sixels."""
_SIXEL_TERMS = re.compile(r"foot|mlterm|contour|yaft|xterm-sixel")


def choose_graphics(
    option: str,
    terminal: Terminal,
    cell: Size | None = None,
    environment: Mapping[str, str] | None = None,
) -> Graphics | None:
    """The graphics for a value of `--graphics`; None for "off".

    A protocol that is named is checked by a question to the terminal; "auto" decides by environment
    variables alone, and never for a session over SSH.
    """
    env = os.environ if environment is None else environment
    if option == "off":
        return None
    for name in get_args(GraphicsProtocol):
        if option == name:
            return probe_terminal(terminal, name, env).with_cell(cell)
    return by_environment(terminal, env).with_cell(cell)


def by_environment(terminal: Terminal, env: Mapping[str, str]) -> Graphics:
    """The graphics of a terminal on this machine, by the variables that it sets."""
    if reason := unsuitable(terminal):
        return Graphics(None, reason)
    if any(env.get(name) for name in _SSH):
        return Graphics(None, "over SSH, name the protocol: --graphics kitty, iterm2 or sixel")
    if env.get("TMUX"):
        return tmux_graphics()
    protocol = _protocol(env)
    if protocol is None:
        reason = "this terminal is not known; `s2r doctor --graphics` asks it for its protocols"
        return Graphics(None, reason)
    return Graphics(protocol, f"{NAMES[protocol]} by environment variables", cell_pixels())


def _protocol(env: Mapping[str, str]) -> GraphicsProtocol | None:
    program, term = env.get("TERM_PROGRAM", ""), env.get("TERM", "")
    if env.get("KITTY_WINDOW_ID") or term in ("xterm-kitty", "xterm-ghostty"):
        return "kitty"
    if program == "ghostty":
        return "kitty"
    if iterm2_by_environment(env):
        return "iterm2"
    if program in _SIXEL_PROGRAMS or _SIXEL_TERMS.match(term) or env.get("WT_SESSION"):
        return "sixel"
    return None


PATIENCE = 3.0
"""Seconds to wait for the answer."""
_NUMBER = 31
_ATTRIBUTES = re.compile(rb"\x1b\[\?([\d;]*)c")
_SIXEL = b"4"
"""The attribute of terminals that draw sixels."""
_CURSOR = re.compile(rb"\x1b\[\d+;\d+R")
_CELL = re.compile(rb"\x1b\[6;(\d+);(\d+)t")
_DRAWN = b"\x1b_Gi=%d;OK" % _NUMBER
_ON_TMUX = re.compile("kitty|ghostty")


def unsuitable(terminal: Terminal) -> str:
    """Why no images can be drawn with these colours and characters; empty if they can."""
    if terminal.ascii or not RenderOptions(mode=terminal.mode).supports_shading:
        return "inline images need 256 colours or more, and UTF-8"
    return ""


def probe_terminal(
    terminal: Terminal,
    wanted: GraphicsProtocol | None = None,
    environment: Mapping[str, str] | None = None,
) -> Graphics:
    """Ask the terminal, or tmux about its terminal, for the `wanted` protocol (default: any)."""
    env = os.environ if environment is None else environment
    if reason := unsuitable(terminal):
        return Graphics(None, reason)
    if not _has_terminal():
        return Graphics(None, "no terminal")
    if env.get("TMUX"):
        return tmux_graphics(wanted)
    if wanted == "iterm2" or (wanted is None and iterm2_by_environment(env)):
        return Graphics("iterm2", f"{NAMES['iterm2']}, not tested", cell_pixels())
    return parse_answer(_ask_terminal(), wanted)


def iterm2_by_environment(env: Mapping[str, str]) -> bool:
    """Whether the terminal names itself as one with iTerm2's protocol."""
    names = env.get("TERM_PROGRAM", ""), env.get("LC_TERMINAL", "")
    return bool({"iTerm.app", "iTerm2", "WezTerm"} & set(names))


def _has_terminal() -> bool:
    return sys.stdin.isatty() and sys.stdout.isatty()


def parse_answer(answer: bytes, wanted: GraphicsProtocol | None = None) -> Graphics:
    """Interpret the answers to `_question` for the `wanted` protocol (default: the best)."""
    attributes = _ATTRIBUTES.search(answer)
    if not attributes:
        return Graphics(None, f"the terminal did not answer within {PATIENCE:.0f} s")
    found = _CELL.search(answer)
    cell = cell_pixels((int(found[2]), int(found[1])) if found else USUAL_CELL)
    has_sixel = _SIXEL in attributes[1].split(b";")
    no_kitty = _without_kitty(answer)
    if wanted != "sixel" and not no_kitty:
        return Graphics("kitty", NAMES["kitty"], cell)
    if wanted != "kitty" and has_sixel:
        return Graphics("sixel", NAMES["sixel"], cell)
    missing = "the terminal does not draw sixels" if not has_sixel else ""
    return Graphics(
        None,
        {"kitty": no_kitty, "sixel": missing}.get(wanted or "")
        or (f"{no_kitty}, and does not draw sixels"),
    )


def _without_kitty(answer: bytes) -> str:
    """Why an answer shows that Kitty's protocol cannot be used; empty if it can."""
    if _DRAWN not in answer:
        return "the terminal does not support the Kitty graphics protocol"
    if len(set(_CURSOR.findall(answer))) != 1:
        return "the terminal supports the Kitty graphics protocol, but not its placeholders"
    return ""


def _question() -> bytes:
    """Send and delete one pixel, and ask for the cell size and the terminal's attributes.

    A terminal without placeholders shows the pixel at once, which moves the cursor.
    """
    pixel = kitty.command(f"a=T,U=1,i={_NUMBER},c=1,r=1,s=1,v=1,f=24,t=d;AAAA")
    return f"\x1b[6n{pixel}\x1b[6n{kitty.forget([_NUMBER])}\x1b[16t\x1b[c".encode()


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
    """The features and names of the terminal that tmux runs in, and the passthrough option.

    Empty if tmux does not answer.
    """
    variables = "#{client_termfeatures}|#{client_termname} #{client_termtype}|#{allow-passthrough}"
    command = ["tmux", "display-message", "-p", variables]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=True)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout


def tmux_graphics(wanted: GraphicsProtocol | None = None) -> Graphics:
    """Ask tmux whether it draws sixels itself, or passes Kitty's protocol on."""
    answer = _ask_tmux().strip()
    if not answer:
        return Graphics(None, "tmux did not name its terminal")
    features, names, passthrough = answer.split("|")
    has_sixel = "sixel" in features.split(",")
    if wanted != "sixel" and _ON_TMUX.search(names.lower()):
        if passthrough not in ("", "0", "off"):
            reason = f"{NAMES['kitty']} through tmux"
            return Graphics("kitty", reason, cell_pixels(), in_tmux=True)
        if wanted == "kitty" or not has_sixel:
            reason = "tmux blocks inline images; run `tmux set -g allow-passthrough on`"
            return Graphics(None, reason)
    if wanted in (None, "sixel"):
        if has_sixel:
            return Graphics("sixel", "sixels by tmux", cell_pixels(), in_tmux=True)
        return Graphics(None, _NO_TMUX_IMAGES)
    if wanted == "iterm2":
        return Graphics(None, "the iTerm2 protocol does not work inside tmux")
    return Graphics(None, "inside tmux, `--graphics kitty` needs kitty or ghostty as its terminal")


_NO_TMUX_IMAGES = (
    "inside tmux, inline images need kitty or ghostty as its terminal, or tmux 3.4 with sixels and "
    "a terminal that draws them"
)
