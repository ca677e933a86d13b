"""The request for a report: selections, runs, and options of the page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

from s2rstore.errors import RequestError
from s2rtui.export.figures import PageOptions
from s2rtui.user_data.notebook import Notes, SavedSelection

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
