"""The UMAP view: embeddings in the plane, sim beside real; near points look alike to the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import SIDES, Bounds, Side
from s2rtui.analysis.binning import Bools, Codes
from s2rtui.analysis.identity_cache import cached_by_identity, identity_key
from s2rtui.canvas import BrushShape, PlotArea
from s2rtui.charts.mark_expressions import area_expression
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.point_bins import known_point, stacked_points, valid_cursor
from s2rtui.charts.view import DrawingView, PointsView, Table
from s2rtui.drawing.drawing import ColourBar, Drawing
from s2rtui.drawing.plot import LEVELS, Phrase, Plot, Points
from s2rtui.drawing.scale import Floats, Interval, Scale, percentile_range, scale_fraction
from s2rtui.session.population_values import population_values
from s2rtui.session.view_settings import ZoomPlane


def umap_plots(
    embeddings: dict[Side, Floats], levels: Codes, selected: Bools, valid: Bools, area: Bounds,
    cursor: int | None = None, trained: Bools | None = None,
) -> tuple[Plot, ...]:  # fmt: skip
    """A plot per side of points (N, 2) on common scales, which show at least `area`."""
    x, y = Scale(area.x0, area.x1, ("u (no unit)", "u")), Scale(area.y0, area.y1, ("v (no unit)",))
    plots = []
    for side, points in embeddings.items():
        u, v = points[:, 0], points[:, 1]
        known = np.isfinite(u) & np.isfinite(v) & valid
        chosen, total = np.count_nonzero(known & selected), np.count_nonzero(known)
        counts = f"{chosen} of {total}" if total else "no coordinates"
        marks = (Points(*_columns(points), levels, selected, valid, (), trained, cursor),)
        title = Phrase(side, side, side), Phrase(counts)
        plots.append(Plot(x, y, marks, side, title, shape="plane", equal=True))
    return tuple(plots)


@cached_by_identity(16)
def _columns(points: Floats) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The columns of points (N, 2); the same points give the same columns, for caches."""
    u, v = np.ascontiguousarray(np.asarray(points, dtype=np.float64).T)
    return u, v


@cached_by_identity(16)
def umap_extent(sim: Floats, real: Floats) -> Bounds:
    """The box of all points of both sides with a small margin; the unit square without any."""
    ends = []
    for side in (sim, real):
        known = side[np.isfinite(side).all(axis=1)]
        if len(known):
            ends += [known.min(axis=0), known.max(axis=0)]
    if not ends:
        return Bounds(0.0, 0.0, 1.0, 1.0)
    low, high = np.min(ends, axis=0), np.max(ends, axis=0)
    margin = 0.02 * float(max(*(high - low), 1e-3))
    (x0, y0), (x1, y1) = low - margin, high + margin
    return Bounds(float(x0), float(y0), float(x1), float(y1))


@cached_by_identity(16)
def distances(sim: Floats, real: Floats) -> NDArray[np.float64]:
    """The distance (N,) between the two points of each instance."""
    apart = np.asarray(sim, dtype=np.float64) - np.asarray(real, dtype=np.float64)
    return np.hypot(apart[:, 0], apart[:, 1])


distance_range = cached_by_identity(16)(percentile_range)


@cached_by_identity(16)
def distance_levels(values: Floats, scale: Interval) -> Codes:
    """The level 1 .. `LEVELS` of each value (N,) on a scale, 0 where it is unknown."""
    steps = np.minimum(np.floor(scale_fraction(values, scale) * LEVELS), LEVELS - 1) + 1
    return np.nan_to_num(steps).astype(np.uint16)


class UmapView(PointsView, DrawingView):
    name = "umap"
    key = "4"
    description = "embeddings in the plane (UMAP), sim and real"
    title = "embeddings in simulation and in reality (UMAP)"
    narrow_ratio = 2.2
    wide_ratio = 0.55
    figure_size = (1600, 800)

    def subtitle(self, scene: Scene) -> str:
        return "coloured by sim-real distance"

    def input(self, scene: Scene) -> dict[Side, Floats]:
        """The embeddings of both sides in the plane, (N, 2) each."""
        columns, population = scene.store.run_columns(scene.state.run), scene.state.population
        sides = zip(SIDES, (columns.sim, columns.real), strict=True)
        return {
            side: population_values(population, columns, stacked_points(each.u, each.v))
            for side, each in sides
        }

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        state = scene.state
        arrays = (*self.input(scene).values(), state.selected, state.base, state.marked)
        return (identity_key(arrays), state.cursor, scene.mark(self.name),
                state.viewport_of(self.name))  # fmt: skip

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        state, embeddings = scene.state, self.input(scene)
        values = distances(embeddings["sim"], embeddings["real"])
        scale = distance_range(values)
        area = state.viewport_of(self.name) or umap_extent(*embeddings.values())
        cursor = valid_cursor(state.cursor, state.base)
        plots = umap_plots(embeddings, distance_levels(values, scale), state.selected, state.base,
                           area, cursor, state.marked)  # fmt: skip
        bar = ColourBar("distance", "", scale, clipped=True)
        return Drawing(plots, notes=((bar,),), brush=scene.mark(self.name), beside=True)

    def numbers(self, scene: Scene) -> Table:
        embeddings, selection = self.input(scene), np.flatnonzero(scene.state.selected)
        sim, real = (embeddings[side][selection] for side in SIDES)
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
        embeddings = self.input(scene)
        side = embeddings["sim" if scene.state.side == "sim" else "real"]
        extent = umap_extent(*embeddings.values())
        return ZoomPlane(self.name, extent, False, known_point(side, scene.state.cursor))

    def to_expression(self, scene: Scene, panel: PlotArea, mark: BrushShape) -> str:
        return area_expression(panel, mark, f"umap.{panel.name}", f"umap.{panel.name}.lasso")

    def points(self, scene: Scene, panel: PlotArea) -> Floats:
        return self.input(scene)["sim" if panel.name == "sim" else "real"]


VIEW = UmapView()
