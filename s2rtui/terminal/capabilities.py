"""Detect colours, background and characters of the terminal from environment variables alone."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from s2rstore.errors import RequestError
from s2rtui.canvas import DARK, LIGHT, THEMES, ColourMode, RenderOptions, Theme
from s2rtui.canvas.block_symbols import Symbols

if TYPE_CHECKING:
    from s2rtui.terminal.graphics.protocols import Graphics

_STREAMS = (0, 1, 2)
_LIGHT_BACKGROUNDS = (7, *range(9, 16))
"""Numbers of ANSI colours that are light; 8 is dark grey."""


@dataclass(frozen=True, slots=True)
class Terminal:
    """The colours and characters to use, and why; `graphics` is None if not probed.

    `symbols` names the block characters of floor plans (see `s2rtui.canvas.block_symbols`).
    """

    mode: ColourMode
    ascii: bool
    reason: str
    graphics: Graphics | None = None
    theme: Theme = DARK
    theme_reason: str = "by default"
    symbols: Symbols = "quadrant"

    @property
    def render_options(self) -> RenderOptions:
        """How views are drawn on this terminal."""
        return RenderOptions(self.theme, self.mode, self.ascii, self.symbols)


def detect(
    colour: str = "auto",
    ascii: bool = False,
    environment: Mapping[str, str] | None = None,
    theme: str = "auto",
    symbols: Symbols = "quadrant",
) -> Terminal:
    """Detect the capabilities; options override the environment.

    Inside tmux octants become sextants: versions that do not know octants drop them, and the rest
    of the line moves.
    """
    env = os.environ if environment is None else environment
    if symbols == "octant" and env.get("TMUX"):
        symbols = "sextant"
    mode, reason = _mode(colour, env)
    chosen, why = _theme(theme, env)
    if not ascii and not _unicode(env):
        ascii, reason = True, f"{reason}; ASCII because the locale is not UTF-8"
    return Terminal(mode, ascii, reason, theme=chosen, theme_reason=why, symbols=symbols)


def _theme(theme: str, env: Mapping[str, str]) -> tuple[Theme, str]:
    """The theme for the terminal's background.

    rxvt, konsole and others state their colours in COLORFGBG as `foreground;background`; no
    terminal is asked, because an answer that arrives late would be read as keys.
    """
    if theme != "auto":
        return THEMES[theme], "by option or setting"
    number = env.get("COLORFGBG", "").rpartition(";")[2]
    if number.isdecimal():
        return LIGHT if int(number) in _LIGHT_BACKGROUNDS else DARK, "by COLORFGBG"
    return DARK, "by default"


def _mode(colour: str, env: Mapping[str, str]) -> tuple[ColourMode, str]:
    if colour != "auto":
        return ColourMode(colour), f"{colour} by option"
    if env.get("NO_COLOR"):
        return ColourMode.NONE, "no colour because NO_COLOR is set"
    term = env.get("TERM", "")
    if env.get("COLORTERM", "").lower() in ("truecolor", "24bit") or term.endswith("-direct"):
        return ColourMode.TRUECOLOR, "truecolor by COLORTERM or TERM"
    if "256" in term:
        return ColourMode.PALETTE, f"256 colours by TERM={term}"
    if term in ("vt100", "vt220", "ansi-m"):
        return ColourMode.NONE, f"no colour by TERM={term}"
    return ColourMode.ANSI, f"16 colours by TERM={term or 'unset'}"


def _unicode(env: Mapping[str, str]) -> bool:
    coerced = env.get("LC_CTYPE") == "C.UTF-8" and not env.get("LC_ALL")
    if coerced and env.get("LANG") in ("C", "POSIX"):
        return False  # set by Python (PEP 538), not by the user
    for name in ("LC_ALL", "LC_CTYPE", "LANG"):
        if env.get(name):
            return "utf" in env[name].lower()
    return True


def refuse_unusable(
    environment: Mapping[str, str] | None = None,
    instead: str = "`s2r snapshot` writes the screen to a file",
) -> None:
    """Raise RequestError, with an alternative, if the application cannot run here.

    Keys come from standard input; the screen is drawn on standard error.
    """
    env = os.environ if environment is None else environment
    if not all(os.isatty(number) for number in _STREAMS):
        raise RequestError(f"no terminal here; {instead}")
    if env.get("TERM", "") in ("dumb", ""):
        raise RequestError(
            f"TERM={env.get('TERM', '') or 'unset'}: it cannot move the cursor; use another "
            f"terminal; {instead}"
        )


def prepare_environment(terminal: Terminal) -> None:
    """Set the variables that Textual reads when it is imported."""
    names = {
        ColourMode.TRUECOLOR: "truecolor", ColourMode.PALETTE: "256", ColourMode.ANSI: "standard",
    }  # fmt: skip
    os.environ["TEXTUAL_ANIMATIONS"] = "none"
    if terminal.mode is ColourMode.NONE:
        os.environ["NO_COLOR"] = "1"
    else:
        os.environ["TEXTUAL_COLOR_SYSTEM"] = names[terminal.mode]


COLUMNS, ROWS = 1000, 500
"""More than four 4K displays show legibly; one drawing takes tens of MB."""


def within_bounds(columns: int, rows: int) -> tuple[int, int]:
    """Limit a terminal size; the upper left part is drawn."""
    return min(max(columns, 0), COLUMNS), min(max(rows, 0), ROWS)
