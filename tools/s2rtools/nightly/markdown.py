"""A night as Markdown, for a chat or a pull request."""

from __future__ import annotations

from collections.abc import Sequence

from s2rstore.security.printable_text import printable
from s2rtools.nightly import night_status as c


def markdown(told: c.Content) -> str:
    """The verdict, what was checked, the estimates and the nights before."""
    night = told.night
    parts = [
        f"# {_cell(told.title)}",
        f"![Gap over time](history.png)\n\n{_cell(told.checks[0].told)}",
        _table(c.CHECKS, c.check_rows(told)),
    ]
    if night.estimates:
        parts += ["## The simulator's parameters", _table(c.ESTIMATES, c.estimate_rows(told))]
    parts += ["## Nights", _table(c.PAST, c.past_rows(told))]
    parts.append("\n".join(f"- {name}: {_cell(value)}" for name, value in c.facts(night)))
    return "\n\n".join(parts) + "\n"


def _table(names: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [names, ["---"] * len(names), *([_cell(value) for value in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _cell(text: str) -> str:
    """Text that neither ends a cell nor begins markup."""
    kept = printable(text)
    for sign in "\\|<>*_`[]":
        kept = kept.replace(sign, f"\\{sign}")
    return kept
