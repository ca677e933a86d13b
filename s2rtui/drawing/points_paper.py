"""Draw the points of a plot on axes of matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import selection_indices
from s2rtui.canvas.raster import cells_with_dots
from s2rtui.drawing.page import Page, draw_ring, value_colours
from s2rtui.drawing.plot import Plot, Points
from s2rtui.drawing.points import point_cells

if TYPE_CHECKING:
    from matplotlib.axes import Axes

POINTS_UP_TO = 40_000
"""Above this number of valid instances, cells are drawn in the colour of their mean level."""
_PER_INCH = 24
"""Such cells per inch."""
_PALEST = 0.3
"""Opacity of a cell with one selected instance, where colours stand for classes."""


def draw_points(axes: Axes, page: Page, plot: Plot, points: Points, inches: tuple[float, float]
                ) -> None:  # fmt: skip
    """Draw points of a plot of `inches` (width, height): each one, or cells where they are many."""
    if int(np.count_nonzero(points.valid)) > POINTS_UP_TO:
        _draw_mesh(axes, page, plot, points, inches)
    else:
        _draw_each(axes, page, points)
    if points.cursor is not None:
        x, y = float(points.x[points.cursor]), float(points.y[points.cursor])
        if np.isfinite([x, y]).all():
            draw_ring(axes, x, y, page.inks.cursor, 80, 8)


def points_note(points: Points) -> str:
    """What the points that are no levels show."""
    parts = []
    if not np.array_equal(points.selected & points.valid, points.valid):
        parts.append("grey: not selected")
    if points.trained is not None:
        parts.append("hole: trained on")
    return "; ".join(parts)


def _colours(page: Page, points: Points) -> NDArray[np.float64]:
    """The colours of the levels, (depth + 1, 3)."""
    if points.inks:
        colours = np.array([getattr(page.inks, ink) for ink in points.inks])
    else:
        colours = value_colours((np.arange(points.depth) + 0.5) / points.depth) / 255.0
    return np.vstack([np.array([page.inks.muted]), colours])


def _draw_each(axes: Axes, page: Page, points: Points) -> None:
    """Unselected points small and grey, the selected by level, the highest on top."""
    inks = page.inks
    members = selection_indices(points.selected, points.valid).members
    within = np.ones(points.x.shape, dtype=np.bool_)
    for values, (low, high) in ((points.x, axes.get_xlim()), (points.y, axes.get_ylim())):
        within &= (values >= min(low, high)) & (values <= max(low, high))
    others = points.valid & within
    others[members] = False
    members = members[within[members]]
    axes.scatter(points.x[others], points.y[others], s=6, color=inks.unselected, linewidths=0,
                 zorder=2, clip_on=False)  # fmt: skip
    if not points.inks:
        members = members[np.argsort(points.levels[members], kind="stable")]
    colours = _colours(page, points)[points.levels[members]]
    axes.scatter(points.x[members], points.y[members], s=24, c=colours,
                 edgecolors=[inks.background], linewidths=0.5, zorder=4, clip_on=False)  # fmt: skip
    if points.trained is not None:
        holes = members[points.trained[members]]
        axes.scatter(points.x[holes], points.y[holes], s=8, color=[inks.background], linewidths=0,
                     zorder=5, clip_on=False)  # fmt: skip


def _draw_mesh(
    axes: Axes, page: Page, plot: Plot, points: Points, inches: tuple[float, float]
) -> None:
    """Cells in the colour of their mean level; with classes the denser the stronger."""
    columns, rows = (max(4, int(length * _PER_INCH)) for length in inches)
    cells = point_cells(points, plot.x, plot.y, columns, rows)
    image = np.zeros((rows, columns, 4))
    image[cells_with_dots(cells.grey)] = (*page.inks.unselected, 0.6)
    held = cells.level >= 0
    image[held, :3] = _colours(page, points)[cells.level[held]]
    share = np.log(cells.count[held]) / max(np.log(cells.count.max(initial=1)), 1e-9)
    image[held, 3] = _PALEST + (1 - _PALEST) * share if points.inks else 1.0
    across, up = (
        scale.value(np.linspace(0, 1, count + 1))
        for scale, count in ((plot.x, columns), (plot.y, rows))
    )
    axes.pcolormesh(across, up, image[::-1], linewidth=0, rasterized=True, zorder=2)
