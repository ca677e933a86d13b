"""The overview: the accuracies of every run, and of every instance as a line across the runs."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from s2rstore.language.canonical_text import string
from s2rstore.metrics.recall import Headline
from s2rstore.records import SIDES
from s2rtui.analysis.identity_cache import identity_key
from s2rtui.canvas import BrushShape, Canvas, PlotArea, Point, RenderOptions, Size, Theme
from s2rtui.charts.mark_expressions import range_expression
from s2rtui.charts.overview import layout, terminal, translators
from s2rtui.charts.overview.bands import BAND_TEXT
from s2rtui.charts.overview.model import OverviewLines
from s2rtui.charts.scene import OverviewRow, Scene
from s2rtui.charts.view import Pane, Pixels, Table, View
from s2rtui.session import Session

ROWS_PER_RUN = 3
"""Preferred number of rows per run, the lines to the next run included."""
FRAME_ROWS = 3
"""Rows of the header and the axis."""


class OverviewView(View):
    name = "overview"
    key = "1"
    pane: Pane = "overview"
    description = "runs: median errors, recall and accuracy in simulation and in reality"
    narrow_ratio = 1.7
    loads = ("rows", "lines")

    def subtitle(self, scene: Scene) -> str:
        lines = scene.loaded.accuracies(scene.state)
        if failed := scene.loaded.failed.get("rows" if not scene.loaded.rows else "lines"):
            return f"accuracy, sim and real: {failed}"
        if lines is None:
            return "accuracy, sim and real"
        found = self.lines(scene)
        drawn = f" bands: {BAND_TEXT}" if found and found.banded[0] else ""
        pale = ", pale: trained on" if lines.trained is not None else ""
        row = next((row for row in self._rows(scene) if row.run == scene.state.run), None)
        if row is None or row.headlines is None:
            return f"{lines.side} accuracy{drawn}{pale}"
        lead = row.headlines[SIDES.index(lines.side)].short
        return f"{lines.side} {lead and f'{lead}; '}accuracy{drawn}{pale}"

    def lines(self, scene: Scene) -> OverviewLines | None:
        """The instances as lines across the runs, once they are loaded."""
        rows, state = self._rows(scene), scene.state
        lines = scene.loaded.accuracies(state)
        if lines is None or any(row.run not in lines.values for row in rows):
            return None
        values = tuple(lines.values[row.run] for row in rows)
        return OverviewLines(
            values, state.selected, state.base, lines.side, state.cursor, lines.trained
        )

    def _rows(self, scene: Scene) -> tuple[OverviewRow, ...]:
        """A row per run; only names until the accuracies are loaded."""
        note = "cannot be read" if "rows" in scene.loaded.failed else "loading"
        empty = (OverviewRow(run, None, None, note=note) for run in scene.state.runs)
        return scene.loaded.rows or tuple(empty)

    def _arguments(self, scene: Scene) -> tuple[tuple[OverviewRow, ...], float | None, int | None]:
        rows = self._rows(scene)
        selected = next((i for i, row in enumerate(rows) if row.run == scene.state.run), None)
        return rows, scene.loaded.baseline, selected

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        lines = identity_key(self.lines(scene))
        rows = scene.loaded.translators
        return *self._arguments(scene), rows, lines, scene.mark(self.name)

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        lines, mark = self.lines(scene), scene.mark(self.name)
        arguments, chart = self._arguments(scene), self._chart_size(scene, size)
        drawn = terminal.draw_overview(*arguments, chart, options, lines, mark)
        if chart == size:
            return drawn
        canvas = Canvas(*size, options)
        canvas.paste(drawn, 0, 0)
        block = size[0], size[1] - chart[1]
        rows = scene.loaded.translators
        canvas.paste(
            translators.draw_translators(rows, scene.state.run, block, options), 0, chart[1]
        )
        return canvas

    def _chart_size(self, scene: Scene, size: Size) -> Size:
        """Columns and rows of the runs, above the rows of the translators."""
        runs = len(self._rows(scene))
        return size[0], size[1] - translators.block_height(scene.loaded.translators, runs, size[1])

    def numbers(self, scene: Scene) -> Table:
        names = ("run", "sim median_m", "sim heading_deg", "sim recall", "real median_m",
                 "real heading_deg", "real recall", "not localised", "sim accuracy", "sim low",
                 "sim high", "real accuracy", "real low", "real high", "n", "independent",
                 "baseline", "note")  # fmt: skip
        rows = [
            (row.run, *_leading(row.headlines), row.sim_accuracy,
             *(row.sim_interval or (None, None)), row.real_accuracy,
             *(row.real_interval or (None, None)), row.n, row.independent,
             scene.loaded.baseline, row.note)
            for row in scene.loaded.rows
        ]  # fmt: skip
        return names, rows

    def summary(self, scene: Scene) -> str:
        runs = [
            f"{row.run}: {_headlines(row.headlines)}accuracy sim "
            f"{_percent(row.sim_accuracy, row.sim_interval)}, "
            f"real {_percent(row.real_accuracy, row.real_interval)}, {row.n} instances"
            f"{f' ({row.note})' if row.note else ''}"
            for row in scene.loaded.rows
        ]
        mean = _percent(scene.loaded.baseline, None)
        accuracies = "; ".join(runs) or "no run"
        text = f"{accuracies}. Baseline (always the mean position): accuracy {mean}."
        run = scene.state.run
        fitted = [
            f"{row.translator}: "
            f"{', '.join(part for part in (row.verdict, row.gain_text(run)) if part)}"
            for row in translators.ordered(scene.loaded.translators, run)
        ]
        return f"{text} Translators: {'; '.join(fitted)}." if fitted else text

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.overview import paper

        rows, baseline, selected = self._arguments(scene)
        lines = self.lines(scene) if len(rows) > 1 else None
        return paper.overview_figure(
            rows, baseline, size, theme, selected, subtitle=_caption(scene, lines), lines=lines
        )

    def height(self, scene: Scene, width: int) -> int:
        if self.unavailable(scene.store):
            return FRAME_ROWS
        rows = scene.loaded.translators
        below = min(translators.MOST_ROWS, len(rows) + 1) if rows else 0
        return ROWS_PER_RUN * (len(scene.state.runs) - 1) + 1 + FRAME_ROWS + below

    def panels(self, scene: Scene, size: Size, options: RenderOptions) -> Sequence[PlotArea]:
        chart = self._chart_size(scene, size)
        return layout.overview_panels(*self._arguments(scene), chart, self.lines(scene))

    def cursor_point(self, scene: Scene, panel: PlotArea) -> Point | None:
        lines, cursor = scene.loaded.accuracies(scene.state), scene.state.cursor
        if lines is None or cursor is None or panel.name not in lines.values:
            return None
        value = float(lines.values[panel.name][cursor])
        return (value, 0.0) if math.isfinite(value) else None

    def instance_at(self, scene: Scene, panel: PlotArea, cell: Point) -> int | None:
        """The selected instance whose line crosses the row of a run at a cell."""
        lines = scene.loaded.accuracies(scene.state)
        names = [row.run for row in self._rows(scene)]
        if lines is None or panel.name not in lines.values or panel.name not in names:
            return None
        if math.floor(cell[1]) != layout.row_in_panel(panel, names.index(panel.name), len(names)):
            return None  # between the rows of runs, where lines run to the next one
        values, value = lines.values[panel.name], panel.to_data(*cell)[0]
        column = panel.to_cells(value, 0.0)[0]
        distance = np.abs(values - value)
        distance = np.where(scene.state.selected & np.isfinite(distance), distance, np.inf)
        iid = int(np.argmin(distance)) if distance.size else 0
        if not distance.size or not np.isfinite(distance[iid]):
            return None
        at = panel.to_cells(float(values[iid]), 0.0)[0]
        return iid if abs(at - column) <= 1 else None

    def click(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> None:
        if panel.name in session.state.runs:
            session.set_run(panel.name)

    def to_expression(self, scene: Scene, panel: PlotArea, mark: BrushShape) -> str:
        side = scene.loaded.lines.side if scene.loaded.lines else scene.state.side
        run = "" if panel.name == scene.state.run else f"run({string(panel.name)})."
        return range_expression(panel, mark, f"{run}{side}.accuracy", 0.0, 1.0)


VIEW = OverviewView()


def _headlines(headlines: tuple[Headline, Headline] | None) -> str:
    parts = zip(SIDES, headlines or (), strict=False)
    return "".join(f"{side} {headline.text}; " for side, headline in parts)


def _leading(headlines: tuple[Headline, Headline] | None) -> list[object]:
    """Median errors and recall of both sides, and the larger number that is not localised."""
    if headlines is None:
        return [None] * 7
    figures = [
        value if math.isfinite(value) else None
        for each in headlines
        for value in (each.position, math.degrees(each.heading), each.recall)
    ]
    return [*figures, max(each.not_localised for each in headlines)]


def _caption(scene: Scene, lines: OverviewLines | None) -> str:
    """The subtitle of the figure: which instances the numbers and the lines stand for."""
    parts = [scene.store.dataset.name, "accuracies over the instances that are new to each run"]
    if lines is not None:
        count = f"{scene.state.expression} ({scene.state.count_text} instances)"
        highlighted, others = lines.banded
        parts.append(f"bands: {BAND_TEXT} of {count}" if highlighted else f"lines: {count}")
        if others:
            parts.append("grey bands: those of the others" if highlighted else
                         f"grey bands: {BAND_TEXT} of the others")  # fmt: skip
    return "  ·  ".join(parts)


def _percent(share: float | None, interval: tuple[float, float] | None) -> str:
    """`98.0 % (97.6 to 98.3)`."""
    if share is None or math.isnan(share):
        return "n/a"
    if interval is None or math.isnan(interval[0]):
        return f"{100 * share:.1f} %"
    return f"{100 * share:.1f} % ({100 * interval[0]:.1f} to {100 * interval[1]:.1f})"
