"""What a report says, before it is a page: texts, tables and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

Cells = Sequence[Sequence[str]]
Facts = Sequence[tuple[str, str]]


@dataclass(frozen=True, slots=True)
class ReportTable:
    """Cells as they are printed; the first names its row, the others are numbers or `texts`."""

    caption: str
    names: Sequence[str]
    rows: Cells
    note: str = ""
    texts: bool = False


@dataclass(frozen=True, slots=True)
class ReportImage:
    """A picture as a data URI, on light ground and, where it has one, on dark.

    `alt` says with numbers what is on it; `wide` asks for the page's whole width.
    """

    light: str
    size: tuple[int, int]
    alt: str
    caption: str = ""
    dark: str = ""
    wide: bool = False
    numbers: ReportTable | None = None


@dataclass(frozen=True, slots=True)
class Example:
    """One instance: its numbers, what else is known of it, its images, the user's remark."""

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
    pictures: Sequence[ReportImage]
    examples: Sequence[Example]


@dataclass(frozen=True, slots=True)
class Section:
    """A selection; `problem` says why there is nothing to tell of it."""

    title: str
    expression: str
    facts: Facts = ()
    runs: ReportTable | None = None
    remarks: ReportTable | None = None
    parts: Sequence[RunPart] = ()
    problem: str = ""


@dataclass(frozen=True, slots=True)
class Report:
    """The page: its front, then a section per selection."""

    title: str
    subtitle: str
    facts: Facts
    findings: Sequence[str]
    runs: ReportTable
    pictures: Sequence[ReportImage]
    sections: Sequence[Section] = field(default=())
