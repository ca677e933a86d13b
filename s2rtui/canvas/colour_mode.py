"""What a terminal can show, apart from all that imports Textual."""

from __future__ import annotations

from enum import Enum


class ColourMode(Enum):
    """The colours of a terminal."""

    TRUECOLOR = "truecolor"
    PALETTE = "256"
    ANSI = "16"
    NONE = "none"
