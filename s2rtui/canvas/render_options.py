"""Render options: theme, colour mode, and glyphs that make colours redundant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from s2rtui.canvas.block_symbols import SYMBOL_SETS, Symbols, SymbolSet
from s2rtui.canvas.colour import DARK, ColourMode, Rgb, Theme
from s2rtui.canvas.fit_text import NO_BREAK

DIGITS = "0123456789"
"""Glyphs of ten steps of a scale, where colours are missing."""


@dataclass(frozen=True, slots=True)
class Glyphs:
    """One glyph per meaning. `arrows` go clockwise on the screen, from the right."""

    sim: str
    real: str
    truth: str
    both: str
    selected: str
    several: str
    unselected: str
    trained: str
    cursor: str
    passed: str
    failed: str
    inconclusive: str
    skipped: str
    baseline: str
    bar: str
    interval: str
    horizontal: str
    vertical: str
    scale_left: str
    scale_right: str
    pointer: str
    planned: str
    below: str
    above: str
    ellipsis: str
    degree: str
    arrows: str
    shades: str


_GLYPHS = {
    "sim": ("◆", "S"),
    "real": ("◇", "R"),
    "truth": ("•", "o"),
    "both": ("◈", "B"),
    "selected": ("●", "*"),
    "several": ("■", "*"),
    "unselected": ("·", ","),
    "trained": ("○", "t"),
    "cursor": ("◉", "@"),
    "passed": ("●", "o"),
    "failed": ("▲", "X"),
    "inconclusive": ("○", "?"),
    "skipped": ("·", "."),
    "baseline": ("┊", ":"),
    "bar": ("━", "="),
    "interval": ("─", "-"),
    "horizontal": ("─", "-"),
    "vertical": ("│", "|"),
    "scale_left": ("├", "|"),
    "scale_right": ("┤", "|"),
    "pointer": ("▶", ">"),
    "planned": ("→", ">"),
    "below": ("▼", "-"),
    "above": ("▲", "+"),
    "ellipsis": ("…", "~"),
    "degree": ("°", "d"),
    "arrows": ("→↘↓↙←↖↑↗", ">\\v/<\\^/"),
    "shades": (" ░▒▓█", " .:-=+*#%@"),
}
"""Each glyph in Unicode and in ASCII."""
UNICODE = Glyphs(**{name: glyphs[0] for name, glyphs in _GLYPHS.items()})
ASCII = Glyphs(**{name: glyphs[1] for name, glyphs in _GLYPHS.items()})


@dataclass(frozen=True, slots=True)
class RenderOptions:
    """How to draw a plot; with `ascii` only ASCII characters are drawn.

    `symbols` names the block characters of floor plans.
    """

    theme: Theme = DARK
    mode: ColourMode = ColourMode.TRUECOLOR
    ascii: bool = False
    symbols: Symbols = "quadrant"

    @property
    def symbol_set(self) -> SymbolSet:
        """The block characters of floor plans."""
        return SYMBOL_SETS[self.symbols]

    @property
    def glyphs(self) -> Glyphs:
        return ASCII if self.ascii else UNICODE

    def role(self, name: str) -> tuple[str, Rgb]:
        """The glyph and the colour of "sim", "real", "truth", "both" or "cursor"."""
        return getattr(self.glyphs, name), getattr(self.theme, name)

    def printable(self, text: str) -> str:
        """The text, with `?` for other characters where only ASCII can be drawn."""
        text = text.replace(UNICODE.degree, self.glyphs.degree)
        if not self.ascii:
            return text
        return "".join(each if each.isascii() or each == NO_BREAK else "?" for each in text)

    @property
    def supports_images(self) -> bool:
        """Whether block characters can show images: needs colours and more than ASCII."""
        return self.mode is not ColourMode.NONE and not self.ascii

    @property
    def supports_shading(self) -> bool:
        """Whether dimmed images stay distinguishable from marks: needs more than 16 colours."""
        return self.supports_images and self.mode is not ColourMode.ANSI


DEFAULT_OPTIONS = RenderOptions()


def heading_arrow(heading: float, y_down: bool, glyphs: Glyphs) -> tuple[str, int, int]:
    """The arrow of a heading (radians) and its direction (columns, rows) on the screen."""
    turn = heading if y_down else -heading
    octant = round(turn / (np.pi / 4)) % 8
    columns = (1, 1, 0, -1, -1, -1, 0, 1)[octant]
    rows = (0, 1, 1, 1, 0, -1, -1, -1)[octant]
    return glyphs.arrows[octant], columns, rows
