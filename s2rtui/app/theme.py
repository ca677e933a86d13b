"""The colours of the plots as a Textual theme, so that widgets share their background."""

from __future__ import annotations

from textual.color import Color
from textual.theme import Theme as TextualTheme

from s2rtui.canvas import Rgb, Theme


def textual_theme(theme: Theme) -> TextualTheme:
    """The style sheet tokens for a canvas theme."""
    return TextualTheme(
        name=f"s2r-{theme.name}",
        primary=_hex(theme.sim),
        secondary=_hex(theme.truth),
        accent=_hex(theme.truth),
        foreground=_hex(theme.text),
        background=_hex(theme.background),
        surface=_hex(theme.highlight),
        panel=_hex(theme.highlight),
        error=_hex(theme.real),
        warning=_hex(theme.truth),
        success=_hex(theme.sim),
        dark=theme.dark,
    )


def _hex(rgb: Rgb) -> str:
    return Color(*rgb).hex
