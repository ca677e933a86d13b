"""The findings on paper: kind, statement and evidence, as a table."""

from __future__ import annotations

import textwrap

from s2rstore.findings import FindingReport
from s2rtui.canvas import LIGHT, Theme
from s2rtui.drawing.page import LETTER, Pixels, new_page, own_settings

_FONT, _SMALLEST_FONT = 9.0, 4.0
_LINE = 1.35
"""Height of a line by the size of its font."""
_LEFT = 0.3


@own_settings()
def findings_figure(
    report: FindingReport, size: Pixels, theme: Theme = LIGHT, title: str = "", subtitle: str = ""
) -> bytes:
    """Draw all findings in `size` pixels, in the largest font that fits."""
    page = new_page(size, theme, title, subtitle)
    inks, (wide, _) = page.inks, page.inches
    high = page.top - 0.3
    font = _FONT
    lines = _lines(report, _letters(wide, font))
    while len(lines) * _LINE * font / 72 > high and font > _SMALLEST_FONT:
        font -= 0.5
        lines = _lines(report, _letters(wide, font))
    step = _LINE * font / 72
    fits = max(1, int(high / step))
    for row, (text, kind) in enumerate(lines[:fits]):
        ink = inks.muted if kind == "muted" else inks.text
        weight = "bold" if kind == "bold" else "normal"
        y = page.top - 0.1 - (row + 0.5) * step
        page.text(_LEFT, y, text, ink, font, va="center", fontweight=weight)
    if len(lines) > fits:
        page.text(_LEFT, 0.1, f"{len(lines) - fits} more lines", inks.muted, font)
    return page.encoded()


def _letters(wide: float, font: float) -> int:
    return max(10, int((wide - 2 * _LEFT) / (LETTER * font)))


def _lines(report: FindingReport, letters: int) -> list[tuple[str, str]]:
    """Texts, each with "bold", "plain" or "muted"."""
    lines: list[tuple[str, str]] = []
    for finding in report.findings:
        mark = "" if finding.evident else " (not evident)"
        lines.append((f"{finding.kind}{mark}", "bold" if finding.evident else "muted"))
        parts = [(finding.text, "plain"), (finding.evidence, "muted")]
        lines += [
            (f"   {line}", style)
            for text, style in parts
            for line in textwrap.wrap(text, letters - 3, break_on_hyphens=False)
        ]
    for note in report.missing:
        lines += [(line, "muted") for line in textwrap.wrap(f"- {note}", letters)]
    return lines
