"""The overview: a line per run."""

from __future__ import annotations

from s2rtui import plots
from s2rtui.canvas import Canvas, Look, Size
from s2rtui.views.contract import Pane, Scene, Table, View


class OverviewView(View):
    name = "overview"
    key = "1"
    pane: Pane = "overview"
    description = "runs: accuracy in simulation and in reality"

    def told(self, scene: Scene) -> str:
        return "accuracy, sim and real"

    def depends(self, scene: Scene) -> tuple[object, ...]:
        state = scene.state
        return (scene.resources.rows, state.run)

    def draw(self, scene: Scene, size: Size, look: Look) -> Canvas:
        rows = scene.resources.rows
        selected = next((i for i, row in enumerate(rows) if row.run == scene.state.run), None)
        return plots.overview(rows, scene.resources.baseline, selected, size, look)

    def numbers(self, scene: Scene) -> Table:
        names = ("run", "sim accuracy", "sim low", "sim high", "real accuracy", "real low",
                 "real high", "n", "baseline")  # fmt: skip
        rows = [
            (row.run, row.sim_accuracy, *(row.sim_interval or (None, None)), row.real_accuracy,
             *(row.real_interval or (None, None)), row.n, scene.resources.baseline)
            for row in scene.resources.rows
        ]  # fmt: skip
        return names, rows

    def height(self, scene: Scene, width: int) -> int:
        return len(scene.state.runs) + 4
