"""The embeddings in the plane, sim beside real: near points look alike to the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from s2rtui.canvas import Canvas, Mark, Panel, RenderOptions, Size, Theme
from s2rtui.charts.mark_expressions import area_expression
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.points import known_point
from s2rtui.charts.umap import terminal
from s2rtui.charts.umap.model import UmapInput, umap_extent, umap_input
from s2rtui.charts.view import Pixels, PointsView, Table
from s2rtui.drawing.scale import Floats
from s2rtui.session.view_settings import ZoomPlane


class UmapView(PointsView):
    name = "umap"
    key = "4"
    description = "embeddings in the plane (UMAP), sim and real"
    narrow_ratio = 1.6
    wide_ratio = 0.55
    figure_size = (1600, 800)

    def subtitle(self, scene: Scene) -> str:
        return "coloured by sim-real distance"

    def input(self, scene: Scene) -> UmapInput:
        viewport = scene.state.viewport_of(self.name)
        return umap_input(scene.store, scene.state, scene.mark(self.name), viewport)

    def numbers(self, scene: Scene) -> Table:
        view = self.input(scene)
        selection = np.flatnonzero(scene.state.selected)
        sim, real = view.sim[selection], view.real[selection]
        distance = np.hypot(*(real - sim).T)
        names: tuple[str, ...] = ("iid", "sim u", "sim v", "real u", "real v", "distance")
        columns = (selection, sim[:, 0], sim[:, 1], real[:, 0], real[:, 1], distance)
        listed: list[Sequence[object]] = [column.tolist() for column in columns]
        if scene.state.marked is not None:
            names, listed = (*names, "split"), [*listed, scene.splits(selection)]
        return names, list(zip(*listed, strict=True))

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        return terminal.draw_umap(self.input(scene), size, options)

    def summary(self, scene: Scene) -> str:
        _, rows = self.numbers(scene)
        distances = np.array([row[5] for row in rows], dtype=np.float64)
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

    def zoom_plane(self, scene: Scene) -> ZoomPlane:
        view = self.input(scene)
        side = view.sim if scene.state.side == "sim" else view.real
        return ZoomPlane(self.name, umap_extent(view), False, known_point(side, view.cursor))

    def panels(self, scene: Scene, size: Size, options: RenderOptions) -> Sequence[Panel]:
        return terminal.umap_panels(self.input(scene), size, options)

    def to_expression(self, scene: Scene, panel: Panel, mark: Mark) -> str:
        return area_expression(panel, mark, f"umap.{panel.name}", f"umap.{panel.name}.lasso")

    def points(self, scene: Scene, panel: Panel) -> Floats:
        view = self.input(scene)
        return view.sim if panel.name == "sim" else view.real


VIEW = UmapView()
