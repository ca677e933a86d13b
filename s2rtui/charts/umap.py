"""The UMAP view: embeddings in the plane, sim beside real; near points look alike to the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import SIDES, Bounds, Side
from s2rtui.analysis.binning import Bins, Bools, Codes, count_selected, selection_indices
from s2rtui.analysis.identity_cache import cached_by_identity, identity_key
from s2rtui.canvas import BrushShape, PlotArea
from s2rtui.charts.mark_expressions import area_expression
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.planes import cursor_phrases, known_point, stacked_points, valid_cursor
from s2rtui.charts.view import PointsView, Table
from s2rtui.drawing.drawing import ColourBar, Drawing
from s2rtui.drawing.plot import LEVELS, Phrase, Plot, Points
from s2rtui.drawing.scale import Floats, Range, Scale, percentile_range, scale_fraction
from s2rtui.session.population_values import population_values
from s2rtui.session.view_settings import ZoomPlane

Plane = tuple[Floats, Floats]
"""Coordinates u and v (N,) of all instances, NaN for none."""


def umap_plots(
    embeddings: dict[Side, Plane], levels: Codes, selected: Bools, valid: Bools, area: Bounds,
    cursor: int | None = None, trained: Bools | None = None,
) -> tuple[Plot, ...]:  # fmt: skip
    """A plot per side of points on common scales, which show at least `area`."""
    x, y = Scale(area.x0, area.x1, ("u (no unit)", "u")), Scale(area.y0, area.y1, ("v (no unit)",))
    selection = selection_indices(selected, valid)
    plots = []
    for side, (u, v) in embeddings.items():
        (chosen,), (total,) = count_selected(_known(u, v), selection)
        counts = f"{chosen} of {total}" if total else "no coordinates"
        marks = (Points(u, v, levels, selected, valid, (), trained, cursor),)
        title = Phrase(side, side, side), Phrase(counts)
        plots.append(Plot(x, y, marks, side, title, shape="plane", equal=True))
    return tuple(plots)


@cached_by_identity(4)
def _known(u: Floats, v: Floats) -> Bins:
    """One bin for the instances that have coordinates."""
    return Bins(np.where(np.isfinite(u) & np.isfinite(v), 0, 1).astype(np.uint16), 1)


@cached_by_identity(8)
def umap_extent(*coordinates: Floats) -> Bounds:
    """The box of all points with a small margin; the unit square without any.

    coordinates: u and v (N,) of one side, then those of the other.
    """
    ends = []
    for column in coordinates:
        known = column[np.isfinite(column)]
        ends.append((known.min(), known.max()) if known.size else (np.inf, -np.inf))
    low = np.minimum(*(np.array([ends[at][0], ends[at + 1][0]]) for at in (0, 2)))
    high = np.maximum(*(np.array([ends[at][1], ends[at + 1][1]]) for at in (0, 2)))
    if not np.isfinite([low, high]).all():
        return Bounds(0.0, 0.0, 1.0, 1.0)
    margin = 0.02 * float(max(*(high - low), 1e-3))
    (x0, y0), (x1, y1) = low - margin, high + margin
    return Bounds(float(x0), float(y0), float(x1), float(y1))


@cached_by_identity(8)
def distances(sim_u: Floats, sim_v: Floats, real_u: Floats, real_v: Floats) -> NDArray[np.float64]:
    """The distance (N,) between the two points of each instance."""
    return np.hypot(np.asarray(sim_u, dtype=np.float64) - real_u,
                    np.asarray(sim_v, dtype=np.float64) - real_v)  # fmt: skip


distance_range = cached_by_identity(16)(percentile_range)


@cached_by_identity(16)
def distance_levels(values: Floats, scale: Range) -> Codes:
    """The level 1 .. `LEVELS` of each value (N,) on a scale, 0 where it is unknown."""
    steps = np.minimum(np.floor(scale_fraction(values, scale) * LEVELS), LEVELS - 1) + 1
    return np.nan_to_num(steps).astype(np.uint16)


class UmapView(PointsView):
    name = "umap"
    key = "4"
    description = "embeddings in the plane (UMAP), sim and real"
    about = "coloured by sim-real distance"
    title = "embeddings in simulation and in reality (UMAP)"
    figure_size = (1600, 800)

    def input(self, scene: Scene) -> dict[Side, Plane]:
        """The embeddings of both sides in the plane."""
        columns, population = scene.store.run_columns(scene.state.run), scene.state.population
        sides = zip(SIDES, (columns.sim, columns.real), strict=True)
        return {
            side: (population_values(population, columns, each.u),
                   population_values(population, columns, each.v))
            for side, each in sides
        }  # fmt: skip

    def _all(self, scene: Scene) -> tuple[Floats, ...]:
        embeddings = self.input(scene)
        return (*embeddings["sim"], *embeddings["real"])

    def missing(self, scene: Scene) -> tuple[str, ...]:
        if any(np.isfinite(column).any() for column in self._all(scene)):
            return ()
        return (f"run {scene.state.run} has no projection; `s2r precompute` computes it",)

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        state = scene.state
        arrays = (*self._all(scene), state.selected, state.base, state.marked)
        return (identity_key(arrays), state.cursor, scene.mark(self.name),
                state.viewport_of(self.name))  # fmt: skip

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        state, embeddings = scene.state, self.input(scene)
        values = distances(*self._all(scene))
        scale = distance_range(values)
        area = state.viewport_of(self.name) or umap_extent(*self._all(scene))
        cursor = valid_cursor(state.cursor, state.base)
        plots = umap_plots(embeddings, distance_levels(values, scale), state.selected, state.base,
                           area, cursor, state.marked)  # fmt: skip
        bar = ColourBar("distance", "", scale, clipped=True)
        return Drawing(
            plots, notes=((bar, *cursor_phrases(cursor)),), brush=scene.mark(self.name), beside=True
        )

    def numbers(self, scene: Scene) -> Table:
        embeddings, selection = self.input(scene), np.flatnonzero(scene.state.selected)
        sim, real = (np.stack(embeddings[side], axis=1)[selection] for side in SIDES)
        distance = np.hypot(*(real - sim).T)
        names: tuple[str, ...] = ("iid", "sim u", "sim v", "real u", "real v", "distance")
        columns = (selection, sim[:, 0], sim[:, 1], real[:, 0], real[:, 1], distance)
        listed: list[Sequence[object]] = [column.tolist() for column in columns]
        if scene.state.marked is not None:
            names, listed = (*names, "split"), [*listed, scene.splits(selection)]
        return names, list(zip(*listed, strict=True))

    def summary(self, scene: Scene) -> str:
        _, rows = self.numbers(scene)
        apart = np.array([row[5] for row in rows], dtype=np.float64)
        apart = apart[np.isfinite(apart)]
        if not apart.size:
            return f"Embeddings of run {scene.state.run}: none of the selection."
        return (
            f"Embeddings of run {scene.state.run} in the plane: the two sides of an instance lie "
            f"{np.median(apart):.2f} apart in the median, {apart.max():.2f} at most."
        )

    def zoom_plane(self, scene: Scene) -> ZoomPlane:
        points = stacked_points(*self.input(scene)["sim" if scene.state.side == "sim" else "real"])
        extent = umap_extent(*self._all(scene))
        return ZoomPlane(self.name, extent, False, known_point(points, scene.state.cursor))

    def to_expression(self, scene: Scene, panel: PlotArea, mark: BrushShape) -> str:
        return area_expression(panel, mark, f"umap.{panel.name}", f"umap.{panel.name}.lasso")

    def points(self, scene: Scene, panel: PlotArea) -> Floats:
        return stacked_points(*self.input(scene)["sim" if panel.name == "sim" else "real"])


VIEW = UmapView()
