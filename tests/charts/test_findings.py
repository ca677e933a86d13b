"""The findings in cells and on paper: every finding is visible, the chosen one with evidence."""

from __future__ import annotations

import pytest

from s2rtui.canvas import DARK
from s2rtui.charts.findings.model import FindingsInput, report_lines
from s2rtui.charts.findings.paper import _lines as paper_lines
from s2rtui.charts.findings.terminal import draw_findings, findings_panels
from tests.charts.examples import finding_report

SIZES = ((80, 24), (70, 36), (82, 17))


@pytest.mark.parametrize("size", SIZES)
def test_all_findings_with_evidence_and_notes_are_shown(size: tuple[int, int]) -> None:
    text = " ".join(" ".join(draw_findings(FindingsInput(finding_report()), size).lines()).split())
    for finding in finding_report().findings:
        for part in (finding.kind, finding.text.split(",")[0], "corrected for 7 rooms"):
            assert part in text
    assert "- gap drift" in text


def test_findings_that_are_not_evident_are_marked() -> None:
    lines = draw_findings(FindingsInput(finding_report()), (80, 24)).lines()
    for number in range(1, 5):
        line = next(line for line in lines if f"kind {number}" in line)
        assert ("? kind" in line) == (number % 2 == 1)


@pytest.mark.parametrize("chosen", [0, 3, 7, -1])
def test_the_chosen_finding_is_visible_and_highlighted(chosen: int) -> None:
    data = FindingsInput(finding_report(12), chosen)
    canvas = draw_findings(data, (80, 4))
    row = next(y for y, line in enumerate(canvas.lines()) if f"kind {chosen % 12 + 1} " in line)
    assert tuple(canvas.bg[row, 5]) == DARK.highlight


def test_evidence_of_the_chosen_finding_is_kept_where_not_all_fits() -> None:
    data = FindingsInput(finding_report(4), 2)
    lines = report_lines(data, 80, 7)
    assert {line.index for line in lines if line.is_evidence} == {2}


def test_a_click_finds_the_finding_of_a_line() -> None:
    data = FindingsInput(finding_report())
    (panel,) = findings_panels(data, (80, 24))
    lines = report_lines(data, 78, 24)
    for y, line in enumerate(lines):
        expected = -1.0 if line.index is None else float(line.index)
        assert panel.to_data(3.5, y + 0.5)[1] == expected


def test_long_texts_are_wrapped_on_paper() -> None:
    lines = paper_lines(finding_report(), 40)
    assert max(len(text) for text, _ in lines) <= 40
    assert sum(style == "bold" for _, style in lines) == 2
