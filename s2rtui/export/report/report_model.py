"""The request for a report, and its content before it is rendered: texts, tables and images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from s2rstore.errors import RequestError
from s2rtui.export.figures import PageOptions
from s2rtui.user_data.notebook import Notes, SavedSelection

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


ReportTheme = Literal["auto", "light", "dark"]
StepCallback = Callable[[int, int, str], None]
"""Receives the number of steps done, their total, and the name of the next step."""


@dataclass(frozen=True, slots=True)
class RequestedSelection:
    """An expression; `name` and `saved` are set for a saved selection of the notebook."""

    expression: str
    name: str = ""
    saved: SavedSelection | None = None

    @property
    def title(self) -> str:
        return f"@{self.name}" if self.name else self.expression


@dataclass(frozen=True, slots=True)
class ReportRequest:
    """Selections and options of a report.

    Without `runs`, a saved selection uses the run of its saving, the others the first run.
    `with_trained` includes the instances that the models were trained on. `heat` is KIND[:MODE] for
    the images of instances; `date` is printed unchanged. `theme` is the theme of page and figures;
    `auto` has both, for light and for dark screens. `page` is the page of the figures, without a
    title of its own.
    """

    selections: tuple[RequestedSelection, ...]
    runs: tuple[str, ...] = ()
    trajectories: tuple[str, ...] | None = None
    other: str | None = None
    with_trained: bool = False
    heat: str | None = None
    title: str = ""
    date: str = ""
    theme: ReportTheme = "auto"
    page: PageOptions = field(default_factory=PageOptions)


def saved(notes: Notes) -> tuple[RequestedSelection, ...]:
    """Return all saved selections of a notebook, ordered by name."""
    return tuple(
        RequestedSelection(selection.expression, name, selection)
        for name, selection in sorted(notes.selections.items())
    )


def selections(
    notes: Notes, expressions: tuple[str, ...], with_saved: bool
) -> tuple[RequestedSelection, ...]:
    """Return the requested expressions, preceded by the saved selections where requested.

    Without expressions all saved selections are used. Raises RequestError if there are none.
    """
    unsaved = tuple(RequestedSelection(expression) for expression in expressions)
    stored = saved(notes) if with_saved or not unsaved else ()
    if not stored and not unsaved:
        raise RequestError("there is no saved selection of this data set; give --select EXPR")
    return (*stored, *unsaved)
