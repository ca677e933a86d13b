"""A plot as data: marks on two scales, with the inks and signs that renderers give them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len

from s2rstore.intervals import Interval
from s2rtui.canvas.marks import Shape
from s2rtui.canvas.render_options import Glyphs
from s2rtui.drawing.image import Image
from s2rtui.drawing.plane_marks import PlaneMark
from s2rtui.drawing.scale import Scale

Floats = NDArray[np.float64]
Ink = Literal[
    "sim", "real", "truth", "both", "text", "muted", "faint", "unselected", "cursor", "planned",
]  # fmt: skip
"""A colour of the theme."""
Sign = Literal[
    "sim", "real", "truth", "both", "cursor", "selected", "trained", "baseline", "vertical",
    "pointer", "passed", "failed", "inconclusive", "skipped", "interval", "planned", "below",
    "above",
]  # fmt: skip
"""What a dot means; each has its glyph and its marker on paper."""
ROLES: tuple[Ink, ...] = ("sim", "real", "truth", "both", "cursor")
"""Inks that are signs, too, which tells them apart without colours."""


@dataclass(frozen=True, slots=True)
class Phrase:
    """A text of a title or a note; the glyph of a sign stands before it.

    short: the text where there is no room for the whole one.
    """

    text: str
    ink: Ink = "muted"
    sign: Sign | None = None
    short: str = ""

    def whole(self, glyphs: Glyphs, room: float = math.inf) -> str:
        """The text with its glyph; the short text if the other is wider than `room` cells."""
        text = f"{getattr(glyphs, self.sign)} {self.text}" if self.sign else self.text
        return self.short if self.short and cell_len(text) > room else text


@dataclass(frozen=True, slots=True, eq=False)
class Bars:
    """A bar between every two of `edges` (n + 1,): `part` (n,) before a grey `whole` (n,)."""

    edges: Floats
    part: NDArray[np.number]
    whole: NDArray[np.number]
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
    scale of y are arrows at its end. On a dial they have lines from the centre to its ring.
    """

    x: Floats
    y: Floats
    ink: Ink
    low: Floats | None = None
    high: Floats | None = None
    sign: Sign | None = None
    name: str = ""
    shift: float = 1.0

    @property
    def drawn_sign(self) -> Sign:
        """The sign, by default that of the ink, which then is one of `ROLES`."""
        return self.sign or cast(Sign, self.ink)

    @classmethod
    def of(cls, x: Floats, intervals: Sequence[Interval], ink: Ink, **style: Any) -> Dots:
        """The values (n,) of intervals with their bounds."""
        columns = np.array([(each.value, each.low, each.high) for each in intervals], dtype=float)
        value, low, high = columns.reshape(-1, 3).T
        return cls(x, value, ink, low, high, **style)


@dataclass(frozen=True, slots=True)
class Rule:
    """A line across the whole plot at a value of one axis."""

    at: float
    axis: Literal["x", "y"] = "x"
    ink: Ink = "unselected"
    dashed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Instances (N,): the valid ones in grey, the selected of them by their level.

    levels: 1 .. `LEVELS` of a scale of colours, or of `inks` where these are classes; 0: unknown.
    trained: instances that the model was trained on, None where none is shown. cursor: an iid.
    """

    x: NDArray[np.floating]
    y: NDArray[np.floating]
    levels: NDArray[np.unsignedinteger]
    selected: NDArray[np.bool_]
    valid: NDArray[np.bool_]
    inks: tuple[Ink, ...] = ()
    trained: NDArray[np.bool_] | None = None
    cursor: int | None = None

    @property
    def depth(self) -> int:
        """The number of levels."""
        return len(self.inks) or LEVELS


_LEAST = 0.05
"""Least inches of a side of a plot on a page."""
LEVELS = 20
"""Steps of the scale of colours of points."""
Mark = Bars | Line | Dots | Rule | Points | Image | PlaneMark


@dataclass(frozen=True, slots=True, eq=False)
class Plot:
    """Marks on a scale of x and one of y; later marks cover earlier ones.

    name: of its panel, in which ranges of x or, on a plane, areas can be brushed. title: texts
    above it. weight: plots with the smallest are left out first where there is no room for all.
    equal: whether the scales are widened so that a unit is as long on both. is_tight: whether a
    page gives such a plot the shape of its scales instead. turns: how the degrees of x, from -180
    to 180, turn on a dial; where there is no room for dials, x is a straight axis.
    """

    x: Scale
    y: Scale
    marks: tuple[Mark, ...]
    name: str = ""
    title: tuple[Phrase, ...] = ()
    weight: float = 0.0
    shape: Shape = "range"
    equal: bool = False
    is_tight: bool = False
    turns: Literal["clockwise", "anticlockwise"] | None = None

    @property
    def image(self) -> Image | None:
        """The image that fills the plot, which has no axes; it has the shape of the scales."""
        return next((mark for mark in self.marks if isinstance(mark, Image)), None)

    @property
    def has_own_shape(self) -> bool:
        """Whether a page gives the plot the shape of its scales."""
        return self.is_tight or self.image is not None

    @property
    def legend(self) -> tuple[Line | Dots, ...]:
        """The marks that have a name, dashed ones last."""
        named = [mark for mark in self.marks if isinstance(mark, Line | Dots) and mark.name]
        return tuple(sorted(named, key=lambda mark: isinstance(mark, Line) and mark.dashed))

    @property
    def y_down(self) -> bool:
        """Whether y grows downwards."""
        return self.y.low > self.y.high

    def fitted(self, width: float, height: float) -> Plot:
        """The plot in an area of this size; with `equal` scales one is widened about its middle."""
        if not self.equal:
            return self
        spans = abs(self.x.high - self.x.low), abs(self.y.high - self.y.low)
        pitch = max(spans[0] / width, spans[1] / height)
        return replace(self, x=_widened(self.x, pitch * width), y=_widened(self.y, pitch * height))

    def tight(self, width: float, height: float) -> tuple[float, float]:
        """The largest size in an area that has the shape of the scales."""
        spans = abs(self.x.high - self.x.low), abs(self.y.high - self.y.low)
        pitch = max(spans[0] / max(width, _LEAST), spans[1] / max(height, _LEAST))
        return spans[0] / pitch, spans[1] / pitch


def _widened(scale: Scale, span: float) -> Scale:
    """The scale about the same middle, `span` long, in its direction."""
    middle, half = (scale.low + scale.high) / 2, span / 2 * (1 if scale.low < scale.high else -1)
    return replace(scale, low=middle - half, high=middle + half)
