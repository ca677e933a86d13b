"""What stands on the map on paper: points, error lines, the cursor, rooms, the scale bar."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds
from s2rtui.analysis.binning import Chosen
from s2rtui.canvas.colour import Theme, turbo
from s2rtui.charts.shared.inputs import Floats, GeoMapInput
from s2rtui.charts.shared.map_model import GeoMapModel, by_value, lined
from s2rtui.charts.shared.paper import unit
from s2rtui.charts.shared.paper_map import MANY, Spots

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LINES_UP_TO = 200
"""Paper is finer than a terminal: this many instances get their error lines."""


def draw_others(axes: Axes, truth: Floats, chosen: Chosen, spots: Spots) -> None:
    """Unselected poses, small and grey."""
    others = chosen.few if chosen.inverted else _outside(chosen)
    grey = np.asarray(truth, dtype=np.float64)[spots.kept(truth, others)]
    ink = unit(spots.theme.unselected)
    axes.scatter(grey[:, 0], grey[:, 1], s=5, color=ink, linewidths=0, zorder=3)


def _outside(chosen: Chosen) -> NDArray[np.intp]:
    inside = chosen.base.copy()
    inside[chosen.few] = False
    return np.flatnonzero(inside)


def draw_values(axes: Axes, view: GeoMapInput, model: GeoMapModel, spots: Spots) -> None:
    """The lit ones coloured by value, the largest on top."""
    ids, shares = by_value(view, model)
    held = spots.last(view.truth, ids)
    lit, shares = np.asarray(view.truth, dtype=np.float64)[ids[held]], shares[held]
    ink = turbo(shares) / 255.0
    ink[~np.isfinite(shares)] = unit(spots.theme.muted)
    draw_dots(axes, lit, ink, spots)


def draw_dots(axes: Axes, points: Floats, ink: NDArray[np.float64], spots: Spots) -> None:
    """Dots with an edge in the page's colour; smaller where they are many."""
    edge = unit(spots.theme.background)
    many = len(points) > MANY
    size, width = (5, 0.0) if many else (26, 0.6)
    axes.scatter(
        points[:, 0], points[:, 1], s=size, c=ink, edgecolors=[edge], linewidths=width, zorder=5
    )


def draw_predictions(axes: Axes, view: GeoMapInput, model: GeoMapModel, spots: Spots) -> None:
    """Sim, real and truth of the lit ones, joined by lines where they are few."""
    ids, theme = model.chosen.members, spots.theme
    edge = unit(theme.background)
    _error_lines(axes, view, lined(view, model, limit=LINES_UP_TO), theme)
    shrink = 0.2 if len(ids) > MANY else 1.0
    sim, real, truth = (
        np.asarray(side, dtype=np.float64)[spots.kept(side, ids)]
        for side in (view.sim, view.real, view.truth)
    )
    axes.scatter(
        sim[:, 0],
        sim[:, 1],
        s=20 * shrink,
        marker="D",
        linewidths=0,
        color=unit(theme.sim),
        zorder=5,
    )
    axes.scatter(
        real[:, 0],
        real[:, 1],
        s=20 * shrink,
        marker="D",
        linewidths=1.1 * shrink,
        zorder=5,
        facecolors=[edge],
        edgecolors=[unit(theme.real)],
    )
    gold = unit(theme.truth)
    axes.scatter(
        truth[:, 0],
        truth[:, 1],
        s=22 * shrink,
        color=gold,
        edgecolors=[edge],
        linewidths=0.6 * shrink,
        zorder=6,
    )


def _error_lines(axes: Axes, view: GeoMapInput, ids: np.ndarray, theme: Theme) -> None:
    from matplotlib.collections import LineCollection

    truth = np.asarray(view.truth, dtype=np.float64)[ids]
    alpha = 0.55 if len(ids) <= 40 else 0.3
    for side, colour in ((view.sim, theme.sim), (view.real, theme.real)):
        ends = np.asarray(side, dtype=np.float64)[ids]
        lines = np.stack([truth, ends], axis=1)
        lines = lines[np.isfinite(lines).all(axis=(1, 2))]
        axes.add_collection(
            LineCollection(
                list(lines), colors=[unit(colour)], linewidths=0.7, alpha=alpha, zorder=4
            )
        )


def draw_cursor(
    axes: Axes, view: GeoMapInput, model: GeoMapModel, theme: Theme, area: Bounds
) -> None:
    """A ring and a heading arrow at the cursor's truth; in mode "full" also its predictions."""
    iid = model.cursor
    if iid is None:
        return
    length = 0.035 * max(area.width, area.height)
    marks = [(view.truth, view.headings, theme.cursor)]
    if view.mode == "full":
        _error_lines(axes, view, np.array([iid]), theme)
        marks.append((view.sim, view.sim_headings, theme.sim))
        marks.append((view.real, view.real_headings, theme.real))
    for points, headings, colour in marks:
        x, y = (float(part) for part in np.asarray(points)[iid])
        if not np.isfinite([x, y]).all():
            continue
        ink = unit(colour)
        axes.scatter([x], [y], s=70, facecolors="none", edgecolors=[ink], linewidths=1.6, zorder=7)
        if headings is not None and np.isfinite(headings[iid]):
            angle = float(headings[iid])
            tip = (x + length * np.cos(angle), y + length * np.sin(angle))
            arrow = {"arrowstyle": "-|>", "color": ink, "lw": 1.6, "shrinkA": 4, "shrinkB": 0}
            axes.annotate("", xy=tip, xytext=(x, y), arrowprops=arrow, zorder=8)
