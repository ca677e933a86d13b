"""Rows of an input file that were not used: how many of each kind, and the first ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

LISTED = 5
"""Rows of a kind that are listed."""


@dataclass(slots=True)
class RowIssues:
    """Counts of issues by kind, and the places and reasons of the first ones of each kind."""

    counts: dict[str, int] = field(default_factory=dict)
    first: dict[str, list[str]] = field(default_factory=dict)

    def add(self, kind: str, place: str, reason: str = "") -> None:
        """Add one issue."""
        self.add_rows(kind, [0], lambda row: f"{place} {reason}".rstrip())

    def add_rows(self, kind: str, rows: Iterable[int], text: Callable[[int], str]) -> None:
        """Add an issue for each of `rows`; `text` says where it is and why."""
        for row in rows:
            listed = self.first.setdefault(kind, [])
            self.counts[kind] = self.counts.get(kind, 0) + 1
            if len(listed) < LISTED:
                listed.append(text(row))

    def merge(self, others: RowIssues) -> None:
        """Add the issues of another file."""
        for kind, count in others.counts.items():
            self.counts[kind] = self.counts.get(kind, 0) + count
            listed = self.first.setdefault(kind, [])
            listed += others.first[kind][: LISTED - len(listed)]

    def lines(self) -> list[str]:
        """A line per kind with its count, and below it the first rows."""
        lines = []
        for kind, count in self.counts.items():
            lines.append(f"{kind}: {count}")
            lines += [f"  {text}" for text in self.first[kind]]
            if count > len(self.first[kind]):
                lines.append(f"  ... and {count - len(self.first[kind])} more")
        return lines
