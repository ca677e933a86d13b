"""The embeddings in the plane: sim beside real, near points saw something alike."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from s2rtui.analysis.identity_cache import identity
from s2rtui.canvas import Canvas, RenderOptions, Size, Theme
from s2rtui.canvas.brush_surface import Mark, Panel, Point
from s2rtui.charts.shared import inputs, view_inputs
from s2rtui.charts.shared.inputs import Floats
from s2rtui.charts.umap import terminal
from s2rtui.charts.view import Pixels, Scene, Table, View, area
from s2rtui.session import Session


class UmapView(View):
    name = "umap"
    key = "4"
    description = "embeddings in the plane (UMAP), sim and real"
    paper = (1600, 800)

    def told(self, scene: Scene) -> str:
        return "embeddings, coloured by the distance to the counterpart"

    def input(self, scene: Scene) -> inputs.UmapInput:
        return view_inputs.umap_input(scene.store, scene.state, scene.mark(self.name))

    def numbers(self, scene: Scene) -> Table:
        view = self.input(scene)
        chosen = np.flatnonzero(scene.state.selected)
        sim, real = view.sim[chosen], view.real[chosen]
        distance = np.hypot(*(real - sim).T)
        names = ("iid", "sim u", "sim v", "real u", "real v", "distance")
        columns = (chosen, sim[:, 0], sim[:, 1], real[:, 0], real[:, 1], distance)
        return names, list(zip(*(column.tolist() for column in columns), strict=True))

    def depends(self, scene: Scene) -> tuple[object, ...]:
        return (identity(self.input(scene)),)

    def draw(self, scene: Scene, size: Size, look: RenderOptions) -> Canvas:
        return terminal.umap(self.input(scene), size, look)

    def words(self, scene: Scene) -> str:
        _, rows = self.numbers(scene)
        distances = np.array([row[-1] for row in rows], dtype=np.float64)
        distances = distances[np.isfinite(distances)]
        if not distances.size:
            return f"Embeddings of run {scene.state.run}: none of the selection."
        return (
            f"Embeddings of run {scene.state.run} in the plane: the two sides of an instance lie "
            f"{np.median(distances):.2f} apart in the median, {distances.max():.2f} at most."
        )

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.umap import paper

        title = f"{scene.state.run}: embeddings in simulation and in reality (UMAP)"
        return paper.umap_figure(self.input(scene), size, theme, title, scene.caption)

    def surface(self, scene: Scene, size: Size, look: RenderOptions) -> Sequence[Panel]:
        return terminal.umap_surface(self.input(scene), size, look)

    def at(self, scene: Scene, panel: Panel) -> Point | None:
        return view_inputs.point_of(self._points(scene, panel), scene.state.cursor)

    def press(self, session: Session, scene: Scene, panel: Panel, point: Point) -> None:
        nearest = view_inputs.nearest(self._points(scene, panel), scene.state.base, point)
        if nearest is not None:
            session.set_cursor(nearest)

    def meaning(self, scene: Scene, panel: Panel, mark: Mark) -> str:
        return area(panel, mark, f"umap.{panel.name}", f"umap.{panel.name}.lasso")

    def _points(self, scene: Scene, panel: Panel) -> Floats:
        view = self.input(scene)
        return view.sim if panel.name == "sim" else view.real
