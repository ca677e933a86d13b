"""A plot as data: marks on two scales, with the inks and signs that renderers give them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from s2rtui.canvas.render_options import Glyphs
from s2rtui.drawing.scale import Scale

Floats = NDArray[np.float64]
Ink = Literal["sim", "real", "truth", "both", "text", "muted", "faint", "unselected", "cursor"]
"""A colour of the theme."""
Sign = Literal[
    "sim", "real", "truth", "both", "cursor", "selected", "trained", "baseline", "vertical",
    "pointer", "passed", "failed", "inconclusive", "skipped",
]  # fmt: skip
"""What a dot means; each has its glyph and its marker on paper."""
ROLES: tuple[Ink, ...] = ("sim", "real", "truth", "both", "cursor")
"""Inks that are signs, too, which tells them apart without colours."""


@dataclass(frozen=True, slots=True)
class Phrase:
    """A text of a title or a note; the glyph of a sign stands before it."""

    text: str
    ink: Ink = "muted"
    sign: Sign | None = None

    def whole(self, glyphs: Glyphs) -> str:
        return f"{getattr(glyphs, self.sign)} {self.text}" if self.sign else self.text


@dataclass(frozen=True, slots=True, eq=False)
class Bars:
    """A bar between every two of `edges` (n + 1,): `part` (n,) before a grey `whole` (n,)."""

    edges: Floats
    part: NDArray[np.integer]
    whole: NDArray[np.integer]
    ink: Ink


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A line through points (n,) whose x increases; NaN interrupts it. name: in the legend."""

    x: Floats
    y: Floats
    ink: Ink
    name: str = ""
    dashed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Dots:
    """Points (n,), with error bars from `low` to `high` (n,) where they are known.

    sign: by default that of the ink. name: in the legend. shift: factor that sets the marks apart
    from those of another side on a page; in cells such marks have no error bars. Points beyond the
    scale of y are arrows at its end.
    """

    x: Floats
    y: Floats
    ink: Ink
    low: Floats | None = None
    high: Floats | None = None
    sign: Sign | None = None
    name: str = ""
    shift: float = 1.0


@dataclass(frozen=True, slots=True)
class Rule:
    """A line across the whole plot at a value of one axis."""

    at: float
    axis: Literal["x", "y"] = "x"
    ink: Ink = "unselected"
    dashed: bool = False


Mark = Bars | Line | Dots | Rule


@dataclass(frozen=True, slots=True, eq=False)
class Plot:
    """Marks on two scales, the first below the others.

    name: of its panel, where ranges of x can be brushed. title: texts above it. weight: plots with
    the smallest are left out first where there is no room for all.
    """

    x: Scale
    y: Scale
    marks: tuple[Mark, ...]
    name: str = ""
    title: tuple[Phrase, ...] = ()
    weight: float = 0.0

    @property
    def legend(self) -> tuple[Line | Dots, ...]:
        """The marks that have a name, dashed ones last."""
        named = [mark for mark in self.marks if isinstance(mark, Line | Dots) and mark.name]
        return tuple(sorted(named, key=lambda mark: isinstance(mark, Line) and mark.dashed))
