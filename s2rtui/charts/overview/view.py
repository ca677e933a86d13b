"""The overview: a line per run, and every instance as a thin line across them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from s2rstore.language.canonical_text import string
from s2rtui.analysis.identity_cache import identity
from s2rtui.canvas import Canvas, RenderOptions, Size, Theme
from s2rtui.canvas.brush_surface import Mark, Panel, Point
from s2rtui.charts.overview import layout, terminal
from s2rtui.charts.shared import inputs
from s2rtui.charts.view import Pane, Pixels, Scene, Table, View, span
from s2rtui.session import Session

ROWS_PER_RUN = 3
"""What a run would like: its marks, and the lines to the next one."""


class OverviewView(View):
    name = "overview"
    key = "1"
    pane: Pane = "overview"
    description = "runs: accuracy in simulation and in reality"
    feeds = ("rows", "lines")

    def told(self, scene: Scene) -> str:
        lines = scene.resources.lines
        told = f", each instance in {lines.side} a line" if lines else ""
        if failed := scene.resources.failed.get("rows" if not scene.resources.rows else "lines"):
            told = f": {failed}"
        return f"accuracy, sim and real{told}"

    def lines(self, scene: Scene) -> inputs.OverviewLines | None:
        """The instances across the runs, once a worker has brought them."""
        lines, rows, state = scene.resources.lines, self._rows(scene), scene.state
        if lines is None or any(row.run not in lines.values for row in rows):
            return None
        values = tuple(lines.values[row.run] for row in rows)
        return inputs.OverviewLines(values, state.selected, state.base, lines.side, state.cursor)

    def _rows(self, scene: Scene) -> tuple[inputs.OverviewRow, ...]:
        """A row per run; until a worker has brought them, their names."""
        note = "cannot be read" if "rows" in scene.resources.failed else "reading"
        empty = (inputs.OverviewRow(run, None, None, note=note) for run in scene.state.runs)
        return scene.resources.rows or tuple(empty)

    def _arguments(
        self, scene: Scene
    ) -> tuple[tuple[inputs.OverviewRow, ...], float | None, int | None]:
        rows = self._rows(scene)
        selected = next((i for i, row in enumerate(rows) if row.run == scene.state.run), None)
        return rows, scene.resources.baseline, selected

    def depends(self, scene: Scene) -> tuple[object, ...]:
        lines = identity(self.lines(scene))
        return *self._arguments(scene), lines, scene.mark(self.name)

    def draw(self, scene: Scene, size: Size, look: RenderOptions) -> Canvas:
        lines, mark = self.lines(scene), scene.mark(self.name)
        return terminal.overview(*self._arguments(scene), size, look, lines, mark)

    def numbers(self, scene: Scene) -> Table:
        names = ("run", "sim accuracy", "sim low", "sim high", "real accuracy", "real low",
                 "real high", "n", "baseline")  # fmt: skip
        rows = [
            (row.run, row.sim_accuracy, *(row.sim_interval or (None, None)), row.real_accuracy,
             *(row.real_interval or (None, None)), row.n, scene.resources.baseline)
            for row in scene.resources.rows
        ]  # fmt: skip
        return names, rows

    def words(self, scene: Scene) -> str:
        told = [
            f"{row.run}: sim {_percent(row.sim_accuracy, row.sim_interval)}, "
            f"real {_percent(row.real_accuracy, row.real_interval)}, {row.n} instances"
            for row in scene.resources.rows
        ]
        mean = _percent(scene.resources.baseline, None)
        return f"Accuracy of {'; '.join(told) or 'no run'}. The mean position alone: {mean}."

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.overview import paper

        rows, baseline, selected = self._arguments(scene)
        lines = self.lines(scene) if len(rows) > 1 else None
        return paper.overview_figure(
            rows, baseline, size, theme, selected, subtitle=_caption(scene, lines), lines=lines
        )

    def height(self, scene: Scene, width: int) -> int:
        return ROWS_PER_RUN * len(scene.state.runs) + 1

    def surface(self, scene: Scene, size: Size, look: RenderOptions) -> Sequence[Panel]:
        return layout.overview_surface(*self._arguments(scene), size, self.lines(scene))

    def at(self, scene: Scene, panel: Panel) -> Point | None:
        lines, cursor = scene.resources.lines, scene.state.cursor
        if lines is None or cursor is None or panel.name not in lines.values:
            return None
        value = float(lines.values[panel.name][cursor])
        return (value, 0.0) if math.isfinite(value) else None

    def press(self, session: Session, scene: Scene, panel: Panel, point: Point) -> None:
        if panel.name in session.state.runs:
            session.set_run(panel.name)

    def meaning(self, scene: Scene, panel: Panel, mark: Mark) -> str:
        side = scene.resources.lines.side if scene.resources.lines else scene.state.side
        run = "" if panel.name == scene.state.run else f"run({string(panel.name)})."
        return span(panel, mark, f"{run}{side}.accuracy", 0.0, 1.0)


def _caption(scene: Scene, lines: inputs.OverviewLines | None) -> str:
    """What the figures are over, and which instances are lines."""
    parts = [scene.store.dataset.name, "figures over the instances new to each model"]
    if lines is not None:
        parts.append(f"lines: {scene.state.expression} ({scene.state.count} instances)")
    return "  ·  ".join(parts)


def _percent(share: float | None, interval: tuple[float, float] | None) -> str:
    """`98.0 % (97.6 to 98.3)`."""
    if share is None or math.isnan(share):
        return "n/a"
    ends = (
        ""
        if interval is None or math.isnan(interval[0])
        else (f" ({100 * interval[0]:.1f} to {100 * interval[1]:.1f})")
    )
    return f"{100 * share:.1f} %{ends}"
