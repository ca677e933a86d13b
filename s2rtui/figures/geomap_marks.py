"""What stands on the map on paper: points, error lines, the cursor, rooms, the scale bar."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from s2rstore.records import Bounds
from s2rtui.canvas.colour import Theme, turbo
from s2rtui.figures.style import plain, unit
from s2rtui.plots.geomap_model import GeoMapModel
from s2rtui.plots.inputs import GeoMapInput
from s2rtui.plots.scale import short, step

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patheffects import AbstractPathEffect

LINES_UP_TO = 200
"""Paper is finer than a terminal: this many instances get their error lines."""


def draw_points(axes: Axes, view: GeoMapInput, model: GeoMapModel, theme: Theme) -> None:
    """Unselected poses small and grey under the lit ones."""
    truth = np.asarray(view.truth, dtype=np.float64)
    grey = truth[model.grey]
    axes.scatter(grey[:, 0], grey[:, 1], s=5, color=unit(theme.unselected), linewidths=0, zorder=3)
    lit = truth[model.order]
    edge = unit(theme.background)
    if view.mode == "colour":
        shares = model.fraction[model.order]
        ink = turbo(shares) / 255.0
        ink[~np.isfinite(shares)] = unit(theme.muted)
        axes.scatter(lit[:, 0], lit[:, 1], s=26, c=ink, edgecolors=[edge], linewidths=0.6, zorder=5)
        return
    few = len(model.order) <= LINES_UP_TO
    _error_lines(axes, view, model.order if few else model.lines, theme)
    sim = np.asarray(view.sim, dtype=np.float64)[model.order]
    real = np.asarray(view.real, dtype=np.float64)[model.order]
    axes.scatter(
        sim[:, 0], sim[:, 1], s=20, marker="D", linewidths=0, color=unit(theme.sim), zorder=5
    )
    axes.scatter(
        real[:, 0],
        real[:, 1],
        s=20,
        marker="D",
        linewidths=1.1,
        zorder=5,
        facecolors=[edge],
        edgecolors=[unit(theme.real)],
    )
    gold = unit(theme.truth)
    axes.scatter(
        lit[:, 0], lit[:, 1], s=22, color=gold, edgecolors=[edge], linewidths=0.6, zorder=6
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


def draw_rooms(axes: Axes, view: GeoMapInput, theme: Theme) -> None:
    """Dashed outlines; each name once, in the first rectangle of that name."""
    from matplotlib import patheffects
    from matplotlib.patches import Rectangle

    halo: list[AbstractPathEffect] = [
        patheffects.withStroke(linewidth=2.5, foreground=unit(theme.background))
    ]
    named: set[str] = set()
    for room in view.rooms:
        corner, wide, high = (room.x0, room.y0), room.x1 - room.x0, room.y1 - room.y0
        axes.add_patch(
            Rectangle(
                corner,
                wide,
                high,
                fill=False,
                edgecolor=unit(theme.muted),
                linewidth=0.8,
                linestyle=(0, (4, 3)),
                zorder=2.5,
            )
        )
        if room.room not in named:
            named.add(room.room)
            top = room.y0 if view.y_down else room.y1
            label = axes.annotate(
                plain(room.room),
                (room.x0, top),
                xytext=(4, -4),
                textcoords="offset points",
                ha="left",
                va="top",
                fontsize=8,
                color=unit(theme.muted),
                zorder=6,
                annotation_clip=True,
            )
            label.set_path_effects(halo)


def draw_scale(axes: Axes, area: Bounds, y_down: bool, theme: Theme) -> None:
    """A bar of round length in the lower left corner."""
    from matplotlib import patheffects

    length = step(area.width / 5, 1)
    if length > area.width / 3:
        length = step(area.width / 10, 1)
    x = area.x0 + 0.03 * area.width
    y = area.y1 - 0.03 * area.height if y_down else area.y0 + 0.03 * area.height
    halo: list[AbstractPathEffect] = [
        patheffects.withStroke(linewidth=4.5, foreground=unit(theme.background))
    ]
    axes.plot(
        [x, x + length],
        [y, y],
        color=unit(theme.text),
        linewidth=2.2,
        solid_capstyle="butt",
        zorder=9,
        path_effects=halo,
    )
    label = axes.annotate(
        f"{short(length)} m",
        (x + length / 2, y),
        xytext=(0, 4),
        textcoords="offset points",
        ha="center",
        va="bottom",
        fontsize=8,
        color=unit(theme.text),
        zorder=9,
    )
    halo_text: list[AbstractPathEffect] = [
        patheffects.withStroke(linewidth=2.5, foreground=unit(theme.background))
    ]
    label.set_path_effects(halo_text)
