"""Recall curves of sim and real, with the shares at the thresholds of the data set."""

from __future__ import annotations

import numpy as np

from s2rstore.index.population import Population
from s2rstore.intervals import Interval
from s2rstore.metrics.recall import recall_curve, side_recall
from s2rstore.reader import Store
from s2rstore.records import Side
from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import Canvas, RenderOptions, Size, Theme
from s2rtui.charts.recall.model import RecallModel, SideCurves
from s2rtui.charts.recall.terminal import draw_recall
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import Pixels, Table, View


class RecallView(View):
    name = "recall"
    key = "Q"
    description = "recall: shares of instances within metres and degrees"
    brushable = False
    narrow_ratio = 1.5
    wide_ratio = 0.65

    def subtitle(self, scene: Scene) -> str:
        return "share of instances within both thresholds"

    def input(self, scene: Scene) -> RecallModel:
        state = scene.state
        return _model(scene.store, state.run, state.selected, state.base, state.population)

    def numbers(self, scene: Scene) -> Table:
        names = ("side", "figure", "metres_m", "heading_deg", "value", "low", "high", "reason",
                 "unit", "n", "not_localised")  # fmt: skip
        rows: list[tuple[object, ...]] = []
        for name, side in self.input(scene).sides:
            found = side.figures
            figures: list[tuple[str, float | None, float | None, Interval, str]]
            figures = [("recall", p.metres, p.degrees, p.share, "") for p in found.points]
            figures += [
                ("median position error", None, None, found.position, "m"),
                ("median heading error", None, None, found.heading.scaled(180 / np.pi), "deg"),
                ("skill", None, None, found.skill, ""),
            ]
            for figure, metres, degrees, interval, unit in figures:
                ends = interval.as_columns("").values()
                counts = found.n, found.not_localised
                rows.append((name, figure, metres, degrees, *ends, unit, *counts))
        return names, rows

    def summary(self, scene: Scene) -> str:
        model = self.input(scene)
        figures = "; ".join(
            f"{name}: sim {sim}, real {real}" for name, sim, _, real, _ in model.rows()
        )
        return f"Recall and errors of {scene.state.run}, {model.counted}. {figures}."

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.recall import paper

        title = f"{scene.state.run}: recall in simulation and in reality"
        return paper.recall_figure(self.input(scene), size, theme, title, scene.caption)

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        return draw_recall(self.input(scene), size, options)


@cached_by_identity(8)
def _model(
    store: Store, run: str, selected: Bools, base: Bools, population: Population
) -> RecallModel:
    """The figures of the selection; of all, not localised ones included, where it is all."""
    is_all = np.array_equal(selected, base)
    members = None if is_all else np.asarray(selected)
    columns = store.run_columns(run)
    lost = population.attempted(store.instances, columns) & ~columns.valid

    def curves(side: Side) -> SideCurves:
        everything = recall_curve(store, run, side, None, population)
        return SideCurves(
            side_recall(store, run, side, members, population=population),
            everything if is_all else recall_curve(store, run, side, members, population),
            None if is_all else everything,
        )

    return RecallModel(curves("sim"), curves("real"), 0 if is_all else int(lost.sum()))


VIEW = RecallView()
