"""Markdown report of a night, for a chat or a pull request."""

from __future__ import annotations

from collections.abc import Sequence

from s2rstore.security.printable_text import printable
from s2rtools.nightly.report_model import (
    CHECK_COLUMNS,
    ESTIMATE_COLUMNS,
    NIGHT_COLUMNS,
    NightReport,
)


def markdown(report: NightReport) -> str:
    """The outcome, the checks, the estimated parameters and the past nights."""
    parts = [
        f"# {_escaped(report.title)}",
        f"![Gap over time](history.png)\n\n{_escaped(report.checks[0].message)}",
        _table(CHECK_COLUMNS, report.check_rows()),
    ]
    if report.night.estimates:
        table = _table(ESTIMATE_COLUMNS, report.estimate_rows())
        parts += ["## Estimated parameters of the simulator", table]
    parts += ["## Nights", _table(NIGHT_COLUMNS, report.night_rows())]
    parts.append("\n".join(f"- {name}: {_escaped(value)}" for name, value in report.facts()))
    return "\n\n".join(parts) + "\n"


def _table(names: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [names, ["---"] * len(names), *([_escaped(value) for value in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _escaped(text: str) -> str:
    """Printable text that cannot end a cell or start markup."""
    escaped = printable(text)
    for sign in "\\|<>*_`[]":
        escaped = escaped.replace(sign, f"\\{sign}")
    return escaped
