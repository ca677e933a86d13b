"""The lines of the findings view: one entry per finding, wrapped to the width."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from dataclasses import dataclass

from s2rstore.findings import Finding, FindingReport

_KIND = 21
"""Columns of the kinds, where there is room beside them."""
_NARROW = 64
"""Columns below which the kind stands in front of the text."""


@dataclass(frozen=True, slots=True)
class FindingsInput:
    """A report and the number of the chosen finding, taken modulo their number."""

    report: FindingReport
    chosen: int = 0

    @property
    def chosen_index(self) -> int | None:
        """The index of the chosen finding; None without any."""
        count = len(self.report.findings)
        return self.chosen % count if count else None

    @property
    def chosen_finding(self) -> Finding | None:
        index = self.chosen_index
        return None if index is None else self.report.findings[index]


@dataclass(frozen=True, slots=True)
class Line:
    """One line: `label` is bold in front of the text; `index` is that of the finding, if any."""

    text: str
    label: str = ""
    index: int | None = None
    is_evidence: bool = False


def report_lines(data: FindingsInput, width: int, height: int) -> list[Line]:
    """The lines for `width` x `height` cells.

    As far as there is room, with the evidence of all findings, or of the chosen one, and with the
    notes on missing ones.
    """
    everything = frozenset(range(len(data.report.findings)))
    chosen = frozenset() if data.chosen_index is None else frozenset({data.chosen_index})
    choices = ((everything, True), (everything, False), (chosen, True), (chosen, False))
    for explained, missing in choices:
        lines = _lines(data.report, width, explained, missing)
        if len(lines) <= height:
            return lines
    return _lines(data.report, width, frozenset(), False)


def _lines(
    report: FindingReport, width: int, explained: frozenset[int], missing: bool
) -> list[Line]:
    """The lines, with the evidence of the findings whose indices are `explained`."""
    lines = []
    for index, finding in enumerate(report.findings):
        mark = "" if finding.evident else "? "
        lines += _entry(f"{mark}{finding.kind}", finding.text, width, index)
        if index in explained and finding.evidence:
            lines += _entry("", finding.evidence, width, index, is_evidence=True)
    if missing:
        for note in report.missing:
            lines += [Line(part) for part in textwrap.wrap(f"- {note}", max(1, width))]
    return lines


def _entry(label: str, text: str, width: int, index: int, is_evidence: bool = False) -> list[Line]:
    pairs: Iterable[tuple[str, str]]
    if width >= _NARROW:
        parts = textwrap.wrap(text, width - _KIND, break_on_hyphens=False)
        labels = [label.ljust(_KIND), *[" " * _KIND] * (len(parts) - 1)]
        pairs = zip(labels, parts, strict=True)
    else:
        parts = textwrap.wrap(f"{label}: {text}" if label else text, max(1, width - 2))
        start = len(label) + 1 if label else 0
        first = [(parts[0][:start], parts[0][start:])] if label else [("", parts[0])]
        pairs = [*first, *(("  ", part) for part in parts[1:])]
    return [Line(part, label, index, is_evidence) for label, part in pairs]
