"""Position errors of the selection, sim above real."""

from __future__ import annotations

from s2rtui import plots
from s2rtui.canvas import Canvas, Look, Size
from s2rtui.views.contract import Scene, View


class ErrorsView(View):
    name = "errors"
    key = "7"
    description = "histogram of the position errors"

    def told(self, scene: Scene) -> str:
        return "position error of the selection"

    def input(self, scene: Scene) -> plots.HistogramInput:
        columns = scene.store.run_columns(scene.state.run)
        state = scene.state
        return plots.HistogramInput(
            columns.sim.error, columns.real.error, state.selected, state.base
        )

    def draw(self, scene: Scene, size: Size, look: Look) -> Canvas:
        return plots.histogram(self.input(scene), size, look)
