"""The histogram of the position errors, sim above real."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from s2rtui.canvas import Canvas, Mark, Panel, Point, RenderOptions, Size, Theme
from s2rtui.charts.errors.model import ErrorsInput, errors_model
from s2rtui.charts.errors.terminal import draw_errors, errors_panels
from s2rtui.charts.mark_expressions import cell_width, number_text, range_expression, round_to_cell
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import Pixels, Table, View

BINS = 20
"""Bins of the table of numbers; the last one includes all larger errors."""


class ErrorsView(View):
    name = "errors"
    key = "7"
    description = "histogram of the position errors"
    narrow_ratio = 1.1

    def subtitle(self, scene: Scene) -> str:
        return "position error of the selection"

    def input(self, scene: Scene) -> ErrorsInput:
        state = scene.state
        columns = scene.store.run_columns(state.run)
        return ErrorsInput(
            columns.sim.error, columns.real.error, state.selected, state.base,
            cursor=state.cursor, mark=scene.mark(self.name),
        )  # fmt: skip

    def numbers(self, scene: Scene) -> Table:
        model = errors_model(self.input(scene), BINS)
        ends = model.edges.tolist()
        counts = (model.sim.highlighted.tolist(), model.real.highlighted.tolist())
        return ("from_m", "to_m", "sim", "real"), list(zip(ends, ends[1:], *counts, strict=False))

    def summary(self, scene: Scene) -> str:
        view = self.input(scene)
        medians = []
        for name, errors in (("sim", view.sim), ("real", view.real)):
            known = errors[scene.state.selected & np.isfinite(errors)]
            if known.size:
                medians.append(f"{name} {np.median(known):.2f} m, at most {known.max():.2f} m")
        return f"Median position error: {'; '.join(medians) or 'none'}."

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.errors import paper

        title = f"{scene.state.run}: position errors in simulation and in reality"
        return paper.errors_figure(self.input(scene), size, theme, title, scene.caption)

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        return draw_errors(self.input(scene), size, options)

    def panels(self, scene: Scene, size: Size, options: RenderOptions) -> Sequence[Panel]:
        return errors_panels(self.input(scene), size, options)

    def cursor_point(self, scene: Scene, panel: Panel) -> Point | None:
        if scene.state.cursor is None:
            return None
        error = float(getattr(self.input(scene), panel.name)[scene.state.cursor])
        return (error, 0.0) if math.isfinite(error) else None

    def to_expression(self, scene: Scene, panel: Panel, mark: Mark) -> str:
        field = f"{panel.name}.error"
        cell = cell_width(panel)
        low, high = sorted(point[0] for point in (mark.points[0], mark.points[-1]))
        if high > panel.to_data(panel.x + panel.width - 1, 0)[0]:
            lowest = max(0.0, round_to_cell(low, cell))
            return f"{field} >= {number_text(lowest)}"  # the last bar has no upper end
        return range_expression(panel, mark, field, 0.0)


VIEW = ErrorsView()
