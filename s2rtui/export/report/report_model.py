"""Content of a report before it is rendered: texts, tables and images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Facts = Sequence[tuple[str, str]]
"""Names with their values."""


@dataclass(frozen=True, slots=True)
class ReportTable:
    """Formatted cells; the first column names the rows, the others are numbers or `texts`.

    expressions: that which selects the instances of each row, if known.
    """

    caption: str
    names: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    texts: bool = False
    expressions: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class ReportImage:
    """An image as a data URI for light screens and, optionally, for dark ones.

    `alt` describes it with its numbers; a `wide` image takes the whole width of the page. A figure
    with a physical size is shown `millimetres` wide.
    """

    light: str
    size: tuple[int, int]
    alt: str
    caption: str = ""
    dark: str = ""
    wide: bool = False
    numbers: ReportTable | None = None
    millimetres: float | None = None


@dataclass(frozen=True, slots=True)
class Example:
    """One instance: numbers, facts, images, and the user's tags and note."""

    iid: int
    table: ReportTable
    facts: Facts
    images: Sequence[ReportImage]
    tags: tuple[str, ...] = ()
    note: str = ""


@dataclass(frozen=True, slots=True)
class RunPart:
    """A selection in one run."""

    run: str
    summary: str
    table: ReportTable
    images: Sequence[ReportImage]
    examples: Sequence[Example]


@dataclass(frozen=True, slots=True)
class Section:
    """A selection; `problem` is the reason why it has no content."""

    title: str
    expression: str
    facts: Facts = ()
    runs: ReportTable | None = None
    remarks: ReportTable | None = None
    parts: Sequence[RunPart] = ()
    problem: str = ""


@dataclass(frozen=True, slots=True)
class Report:
    """The page: an overview of all runs, then a section per selection.

    findings: lines, each with the expression that selects its instances, or none.
    theme: the colours of the page, for light screens where it has figures for both.
    """

    title: str
    subtitle: str
    facts: Facts
    findings: Sequence[tuple[str, str]]
    runs: ReportTable
    images: Sequence[ReportImage]
    sections: Sequence[Section] = ()
    theme: Literal["light", "dark"] = "light"
