"""Numbers with their intervals: rows of the table of a statistical view and of `s2r show`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from s2rstore.intervals import Interval
from s2rstore.records import Side
from s2rtui.drawing.plot import Ink
from s2rtui.drawing.table import Cell, Column, Row, TableSpec


@dataclass(frozen=True, slots=True)
class Figure:
    """A number with its interval.

    of: what it is of, such as a room. text: what the table shows in place of the number; detail:
    in place of the bounds. in_table: whether the table has it; `s2r show` prints all.
    expression: that which selects the instances that it stands for, if any.
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
    expression: str = ""

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
    shown = _by_label(figures)
    rows = (
        Row((Cell(label), *(found[side].cell if side in found else Cell() for side in figures)))
        for label, found in shown.items()
    )
    return TableSpec((Column(""), *(Column(side, side) for side in figures)), tuple(rows))


def figure_choices(figures: Figures, side: Side) -> list[tuple[str, str]]:
    """The name of each row of the table, and the expression of its figure of a side."""
    shown = _by_label(figures)
    return [(label, found[side].expression if side in found else "")
            for label, found in shown.items()]  # fmt: skip


def _by_label(figures: Figures) -> dict[str, dict[Ink, Figure]]:
    """The figures of the table by their label and side."""
    shown: dict[str, dict[Ink, Figure]] = {}
    for side, found in figures.items():
        for figure in found:
            if figure.in_table:
                shown.setdefault(figure.label, {})[side] = figure
    return shown
