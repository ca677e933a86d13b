"""The findings view: what the store shows about the run, each with evidence and its selection."""

from __future__ import annotations

from collections.abc import Sequence

from s2rstore.errors import sentence
from s2rstore.findings import Finding, FindingReport
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import Pane, Table, View
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.table import Cell, Column, Row, TableSpec
from s2rtui.session import navigation, view_settings
from s2rtui.session.session import Session

PANEL = "findings"


def findings_drawing(
    report: FindingReport, chosen: int | None = None, selections: bool = False
) -> Drawing:
    """A row per finding: its kind, with `?` where it is not evident, its text and its evidence.

    selections: whether the expressions that select their instances are shown. Notes say which
    findings are missing.
    """
    rows = tuple(_row(finding, selections) for finding in report.findings)
    table = TableSpec((Column(""), Column("", wraps=True)), rows, PANEL, chosen=chosen)
    return Drawing(table=table, notes=tuple(f"- {note}" for note in report.missing))


def _row(finding: Finding, selections: bool) -> Row:
    mark = "" if finding.evident else "? "
    notes = [finding.evidence] if finding.evidence else []
    if selections and finding.expression is not None:
        notes.append(f"select: {finding.expression}")
    cells = Cell(f"{mark}{finding.kind}"), Cell(finding.text)
    return Row(cells, "text" if finding.evident else "muted", finding.evident, tuple(notes))


class FindingsView(View):
    name = "findings"
    has_rows = True
    key = "I"
    pane: Pane = "centre"
    description = "what the store shows about the run, with evidence"
    loads = ("findings",)
    brushable = False
    counts_instances = False
    figure_size = (1600, 1000)

    def subtitle(self, scene: Scene) -> str:
        report = self.input(scene)
        if report is None:
            return "what the store shows"
        return f"{report.summary} (enter: select)"

    def input(self, scene: Scene) -> FindingReport | None:
        """The findings about the present run; None until they are computed."""
        report = scene.loaded.findings
        return report if report is not None and report.run == scene.state.run else None

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        state, failed = scene.state, scene.loaded.failed.get("findings")
        is_active = state.view == self.name
        chosen = state.chosen_row(self.name)
        return scene.loaded.findings, state.run, chosen, is_active, failed

    def missing(self, scene: Scene) -> tuple[str, ...]:
        report = self.input(scene)
        if report is None:
            return (scene.loaded.failed.get("findings", "findings are being computed"),)
        return () if report.findings or report.missing else ("nothing is known about this run",)

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        report = self.input(scene)
        assert report is not None
        return findings_drawing(report, self.chosen_row(scene))

    def row_names(self, scene: Scene) -> Sequence[str]:
        report = self.input(scene)
        return [str(place) for place in range(len(report.findings))] if report else []

    def select_row(self, session: Session, scene: Scene, row: int) -> None:
        """Select the instances of a finding, and show what it names."""
        report = self.input(scene)
        assert report is not None
        session.dispatch(view_settings.choose_row, self.name, str(row))
        session.dispatch(navigation.open_finding, report.findings[row])

    def numbers(self, scene: Scene) -> Table:
        names = ("finding", "evident", "run", "n", "low", "high", "of", "expression", "text",
                 "evidence")  # fmt: skip
        report = self.input(scene)
        rows = []
        for finding in report.findings if report else ():
            known = finding.interval
            bounds = (None, None) if known is None else known.bounds
            rows.append((finding.kind, "yes" if finding.evident else "no", finding.run, finding.n,
                         *bounds, finding.interval_of, finding.expression, finding.text,
                         finding.evidence))  # fmt: skip
        return names, rows

    def summary(self, scene: Scene) -> str:
        report = self.input(scene)
        if report is None:
            return "There are no findings."
        evident = [f"{f.kind}: {f.text}" for f in report.findings if f.evident]
        return f"{'. '.join([sentence(report.summary), *evident])}."

    def heading(self, scene: Scene) -> tuple[str, str]:
        subtitle = f"{scene.store.dataset.name}  ·  95 % intervals, instances new to the run"
        return f"{scene.state.run}: findings", subtitle


VIEW = FindingsView()
