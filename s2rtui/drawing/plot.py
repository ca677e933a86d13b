"""A drawing as data: plots of marks on two scales, a table and notes.

A view makes it from its numbers; the renderers `cells` and `paper` draw it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.intervals import Interval
from s2rtui.drawing.scale import Scale

Floats = NDArray[np.float64]
Ink = Literal["sim", "real", "truth", "both", "text", "muted", "faint", "unselected", "cursor"]
"""A colour of the theme."""
ROLES: tuple[Ink, ...] = ("sim", "real", "truth", "both", "cursor")
"""Inks that also have a glyph, which tells them apart without colours."""


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

    shift: factor that sets the marks apart from those of another side on a wide page.
    """

    x: Floats
    y: Floats
    ink: Ink
    low: Floats | None = None
    high: Floats | None = None
    shift: float = 1.0


@dataclass(frozen=True, slots=True)
class Rule:
    """A line across the whole plot at a value of one axis."""

    at: float
    axis: Literal["x", "y"] = "x"
    ink: Ink = "unselected"


Mark = Line | Dots | Rule


@dataclass(frozen=True, slots=True, eq=False)
class Plot:
    """Marks on two scales, the first below the others."""

    x: Scale
    y: Scale
    marks: tuple[Mark, ...]

    @property
    def legend(self) -> tuple[Line, ...]:
        """The lines that have a name, dashed ones last."""
        named = (mark for mark in self.marks if isinstance(mark, Line) and mark.name)
        return tuple(sorted(named, key=lambda line: line.dashed))


@dataclass(frozen=True, slots=True)
class Cell:
    """A text of a table, and a detail behind it that is left out where there is no room."""

    text: str
    detail: str = ""

    @property
    def whole(self) -> str:
        return f"{self.text} ({self.detail})" if self.detail else self.text


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table; with an ink of `ROLES` its glyph stands before the name."""

    name: str
    ink: Ink = "muted"


@dataclass(frozen=True, slots=True)
class TableSpec:
    """Rows of cells below columns; the first cell of a row is its name."""

    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]

    def sentences(self, blank: str = " ") -> Iterator[str]:
        """Yield each row as `name: column cell, column cell`; `blank` is that inside of cells."""
        for name, *cells in self.rows:
            parts = zip(self.columns[1:], cells, strict=True)
            known = [f"{column.name} {cell.whole}".strip() for column, cell in parts if cell.text]
            yield f"{name.whole}: {', '.join(text.replace(' ', blank) for text in known)}"


@dataclass(frozen=True, slots=True)
class Figure:
    """A number with its interval: a row of the table and of `s2r show`.

    of: what it is of, such as a room. text: what the table shows in place of the number; detail:
    in place of the bounds. in_table: whether the table has it; `s2r show` prints all.
    """

    name: str
    interval: Interval
    unit: str = ""
    digits: int = 2
    of: str = ""
    n: int | None = None
    text: str = ""
    detail: str = ""
    in_table: bool = True

    @property
    def label(self) -> str:
        return f"{self.name} {self.of}".strip()

    @property
    def cell(self) -> Cell:
        number = f"{{:.{self.digits}f}}".format
        known = math.isfinite(self.interval.value)
        text = self.text or (f"{number(self.interval.value)} {self.unit}" if known else "n/a")
        bounds = self.interval.bounds_text(number) if self.interval.is_known else ""
        return Cell(text.strip(), self.detail or bounds)


Figures = Mapping[Ink, Sequence[Figure]]
"""Figures by side."""
NUMBERS = ("side", "figure", "of", "value", "low", "high", "reason", "unit", "n", "detail")


def figure_rows(figures: Figures) -> Iterator[tuple[object, ...]]:
    """Yield the figures as rows of the columns `NUMBERS`."""
    for side, found in figures.items():
        for each in found:
            ends = each.interval.as_columns("").values()
            yield side, each.name, each.of or None, *ends, each.unit, each.n, each.detail or None


def figure_table(figures: Figures) -> TableSpec:
    """The figures side by side, a row for each name."""
    cells = {
        side: {f.label: f.cell for f in found if f.in_table} for side, found in figures.items()
    }
    labels = dict.fromkeys(label for each in cells.values() for label in each)
    rows = (
        (Cell(label), *(each.get(label, Cell("")) for each in cells.values())) for label in labels
    )
    return TableSpec((Column(""), *(Column(side, side) for side in cells)), tuple(rows))


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """What a view shows: a plot above a table above notes; each part may be absent."""

    plot: Plot | None = None
    table: TableSpec | None = None
    notes: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The table and the notes in sentences, for screen readers."""
        rows = [] if self.table is None else list(self.table.sentences())
        return ". ".join([*rows, *self.notes])
