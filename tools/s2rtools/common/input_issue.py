"""Defects of input that are reported while the rest is read."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from s2rstore.errors import shortened
from s2rstore.security.printable_text import printable

LISTED = 5
"""Issues of a kind that are listed by default."""
_MAX_SHOWN = 300
"""Characters of a file name, and of a reason, in a message."""


@dataclass(frozen=True, slots=True)
class InputIssue:
    """A defect of the input: its kind, the file and the reason; its text is one line."""

    kind: str
    file: str
    detail: str = ""

    def __str__(self) -> str:
        parts = shortened(self.file, _MAX_SHOWN), self.kind, shortened(self.detail, _MAX_SHOWN)
        return printable(": ".join(part for part in parts if part))

    def of_side(self, side: str) -> InputIssue:
        """The same issue of one of two recordings, which may have files of equal names."""
        return replace(self, file=f"{side}: {self.file}")


def issue_lines(issues: Iterable[InputIssue], most: int = LISTED) -> list[str]:
    """A line for each kind with the number of its issues, and below it the first `most` ones."""
    kinds: dict[str, list[InputIssue]] = {}
    for issue in issues:
        kinds.setdefault(issue.kind, []).append(issue)
    lines = []
    for kind, members in kinds.items():
        lines.append(printable(f"{kind}: {len(members)}"))
        for issue in members[:most]:
            texts = (shortened(text, _MAX_SHOWN) for text in (issue.file, issue.detail))
            lines.append(printable(f"  {' '.join(texts)}".rstrip()))
        if len(members) > most:
            lines.append(f"  ... and {len(members) - most} more")
    return lines
