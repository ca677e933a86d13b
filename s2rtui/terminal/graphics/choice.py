"""Choose a graphics protocol by option `--graphics` and by environment variables."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from typing import get_args

from s2rtui.canvas import Size
from s2rtui.terminal.capabilities import Terminal
from s2rtui.terminal.graphics.probe import (
    iterm2_by_environment,
    probe_terminal,
    tmux_graphics,
    unsuitable,
)
from s2rtui.terminal.graphics.protocols import NAMES, Graphics, GraphicsProtocol, cell_pixels

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
