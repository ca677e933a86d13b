"""What the store shows about the run: each finding with its evidence and its selection."""

from __future__ import annotations

from collections.abc import Sequence

from s2rstore.errors import sentence
from s2rstore.findings import FindingReport
from s2rtui.canvas import Canvas, Panel, Point, RenderOptions, Size, Theme
from s2rtui.charts.findings.model import FindingsInput
from s2rtui.charts.findings.terminal import draw_findings, findings_panels
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import Pane, Pixels, Table, View
from s2rtui.session import Session, findings


class FindingsView(View):
    name = "findings"
    key = "I"
    pane: Pane = "centre"
    description = "what the store shows about the run, with evidence"
    loads = ("findings",)
    brushable = False
    counts_instances = False
    figure_size = (1600, 1000)

    def subtitle(self, scene: Scene) -> str:
        report = self._report(scene)
        if report is None:
            return "what the store shows"
        return f"{report.summary} (enter: select)"

    def _report(self, scene: Scene) -> FindingReport | None:
        """The findings about the present run; None until they are computed."""
        report = scene.resources.findings
        return report if report is not None and report.run == scene.state.run else None

    def input(self, scene: Scene) -> FindingsInput | None:
        report = self._report(scene)
        return None if report is None else FindingsInput(report, scene.state.finding)

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        state, failed = scene.state, scene.resources.failed.get("findings")
        is_active = state.view == self.name
        return scene.resources.findings, state.run, state.finding, is_active, failed

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        data = self.input(scene)
        if data is not None:
            return draw_findings(data, size, options, scene.state.view == self.name)
        canvas = Canvas(*size, options)
        failed = scene.resources.failed.get("findings", "findings are being computed")
        canvas.text(0, 0, failed, options.theme.muted)
        return canvas

    def panels(self, scene: Scene, size: Size, options: RenderOptions) -> Sequence[Panel]:
        data = self.input(scene)
        return () if data is None else findings_panels(data, size, options)

    def click(self, session: Session, scene: Scene, panel: Panel, point: Point) -> None:
        data, index = self.input(scene), round(point[1])
        if data is not None and 0 <= index < len(data.report.findings):
            session.dispatch(findings.move, index - session.state.finding)
            session.dispatch(findings.open_finding, data.report.findings[index])

    def numbers(self, scene: Scene) -> Table:
        names = ("finding", "evident", "run", "n", "low", "high", "of", "expression", "text",
                 "evidence")  # fmt: skip
        report = self._report(scene)
        rows = []
        for finding in report.findings if report else ():
            known = finding.interval
            bounds = (None, None) if known is None else known.bounds
            rows.append((finding.kind, "yes" if finding.evident else "no", finding.run, finding.n,
                         *bounds, finding.interval_of, finding.expression, finding.text,
                         finding.evidence))  # fmt: skip
        return names, rows

    def summary(self, scene: Scene) -> str:
        report = self._report(scene)
        if report is None:
            return "There are no findings."
        evident = [f"{f.kind}: {f.text}" for f in report.findings if f.evident]
        return f"{'. '.join([sentence(report.summary), *evident])}."

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.findings import paper

        report = self._report(scene) or FindingReport(scene.state.run, ())
        title = f"{scene.state.run}: findings"
        subtitle = f"{scene.store.dataset.name}  ·  95 % intervals, instances new to the run"
        return paper.findings_figure(report, size, theme, title, subtitle)


VIEW = FindingsView()
