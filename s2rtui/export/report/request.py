"""What a report is asked to hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from s2rstore.errors import RequestError
from s2rtui.user_data.notebook import Notes, SavedSelection

Told = Callable[[int, int, str], None]
"""Hears of steps done, steps in all, and what is done next."""


@dataclass(frozen=True, slots=True)
class RequestedSelection:
    """A selection by its expression; `saved` is what a notebook keeps of it under `name`."""

    expression: str
    name: str = ""
    saved: SavedSelection | None = None

    @property
    def title(self) -> str:
        return f"@{self.name}" if self.name else self.expression


@dataclass(frozen=True, slots=True)
class ReportRequest:
    """`runs` empty: of a saved selection the run that it was saved on, else the first.

    `heat` is KIND[:MODE] on the pictures of instances; `date` is printed as it is.
    """

    selections: tuple[RequestedSelection, ...]
    runs: tuple[str, ...] = ()
    trajectories: tuple[str, ...] | None = None
    other: str | None = None
    heat: str | None = None
    title: str = ""
    date: str = ""
    dark: bool = True


def saved(notes: Notes) -> tuple[RequestedSelection, ...]:
    """All that a notebook keeps, by name."""
    return tuple(
        RequestedSelection(kept.expression, name, kept)
        for name, kept in sorted(notes.selections.items())
    )


def selections(
    notes: Notes, expressions: tuple[str, ...], with_saved: bool
) -> tuple[RequestedSelection, ...]:
    """Those that options name: expressions, and the saved ones where asked for or alone.

    Raises RequestError where there is none.
    """
    given = tuple(RequestedSelection(expression) for expression in expressions)
    kept = saved(notes) if with_saved or not given else ()
    if not kept and not given:
        raise RequestError("no saved selections of this data set; give --select EXPR")
    return (*kept, *given)
