"""Recall curves of sim and real, with the shares at the thresholds of the data set."""

from __future__ import annotations

import numpy as np

from s2rstore.index.population import Population
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
        names = ("side", "figure", "metres_m", "heading_deg", "low", "value", "high", "n",
                 "not_localised")  # fmt: skip
        rows: list[tuple[object, ...]] = []
        for name, side in self.input(scene).sides:
            found = side.figures
            counts = found.n, found.not_localised
            rows += [
                (name, "recall", p.metres, p.degrees, *_ends(p.share), *counts)
                for p in found.points
            ]
            in_degrees = found.heading.scaled(180 / np.pi)
            for figure, interval in (("median position error m", found.position),
                                     ("median heading error deg", in_degrees),
                                     ("skill", found.skill)):  # fmt: skip
                rows.append((name, figure, None, None, *_ends(interval), *counts))
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


def _ends(interval: object) -> tuple[float | None, ...]:
    """Low, value and high; None where they are infinite."""
    ends = (getattr(interval, name) for name in ("low", "value", "high"))
    return tuple(float(end) if np.isfinite(end) else None for end in ends)


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
