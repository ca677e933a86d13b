"""Instances as lines across the runs, on paper: a segment per pair of bins that occurs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from s2rtui.canvas.colour import Rgb, Theme
from s2rtui.charts.overview.line_drawing import own_accuracies
from s2rtui.charts.overview.lines import MANY, levels, pair_counts
from s2rtui.charts.shared.inputs import Interval, OverviewLines
from s2rtui.charts.shared.paper import unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patheffects import AbstractPathEffect

CLEAR = 60
"""So many selected lines stand in full strength; more are paler, down to a third."""
FINE, COARSE = 200, 100
"""Bins of an accuracy axis: where lines can be told apart, and where they are a density."""


def draw_lines(axes: Axes, lines: OverviewLines, axis: Interval, theme: Theme) -> None:
    """Others in grey, the selected in their side's colour, the cursor's own line on top."""
    size = COARSE if len(lines.valid) > MANY else FINE
    found = pair_counts(lines, axis, size)
    colour = theme.sim if lines.side == "sim" else theme.real
    lit = int(np.count_nonzero(np.asarray(lines.selected) & lines.valid))
    for part, ink, order, strength in (
        (1, theme.unselected, 1.0, 0.45),
        (0, colour, 1.2, 0.75 * min(1.0, max(0.3, math.sqrt(CLEAR / max(lit, 1))))),
    ):
        peak = max((float(pair[part].max()) for pair in found), default=0.0)
        for row, pair in enumerate(found):
            _segments(axes, pair[part], axis, row, (peak, strength), ink, order)
    if lines.cursor is not None:
        _own(axes, lines, axis, theme)


def _segments(
    axes: Axes,
    counts: NDArray[np.intp],
    axis: Interval,
    row: int,
    scale: tuple[float, float],
    ink: Rgb,
    order: float,
) -> None:
    """From run `row` to the next one, the denser the stronger; `scale`: (peak, opacity there)."""
    from matplotlib.collections import LineCollection

    first, second = np.nonzero(counts)
    if not first.size:
        return
    shares = levels(counts[first, second].astype(np.float64), scale[0])
    ordered = np.argsort(shares, kind="stable")
    middles = 100 * (axis[0] + (np.arange(len(counts)) + 0.5) / len(counts) * (axis[1] - axis[0]))
    starts = np.stack([middles[first], np.full(first.size, float(row))], axis=1)
    ends = np.stack([middles[second], np.full(first.size, row + 1.0)], axis=1)
    colours = np.empty((first.size, 4))
    colours[:, :3] = unit(ink)
    colours[:, 3] = scale[1] * (0.25 + 0.75 * shares) if scale[0] < 100 else scale[1] * shares
    segments = np.stack([starts, ends], axis=1)[ordered]
    collection = LineCollection(
        list(segments), colors=list(map(tuple, colours[ordered])), linewidths=0.7, zorder=order
    )
    axes.add_collection(collection)


def _own(axes: Axes, lines: OverviewLines, axis: Interval, theme: Theme) -> None:
    """A ring per run at the cursor's accuracy with its number, joined where known."""
    from matplotlib import patheffects

    found = own_accuracies(lines)
    kept = np.array([np.nan if value is None else value for value in found])
    places = 100 * np.clip(kept, *axis)
    rows = np.arange(len(kept))
    ink = unit(theme.cursor)
    axes.plot(places, rows, color=ink, linewidth=1.4, zorder=3.5)
    axes.scatter(
        places, rows, s=34, facecolors=[unit(theme.background)], edgecolors=[ink], zorder=3.6
    )
    halo: list[AbstractPathEffect] = [
        patheffects.withStroke(linewidth=2, foreground=unit(theme.background))
    ]
    for place, row, value in zip(places.tolist(), rows.tolist(), found, strict=True):
        if value is not None:
            label = axes.annotate(
                f"{100 * value:.1f}",
                (place, row),
                xytext=(6, -9),
                textcoords="offset points",
                fontsize=7,
                zorder=6,
            )
            label.set_color(ink)
            label.set_path_effects(halo)


def keys(lines: OverviewLines | None, theme: Theme) -> list[tuple[Rgb, str]]:
    """Colours and names for the legend."""
    if lines is None:
        return []
    colour = theme.sim if lines.side == "sim" else theme.real
    found: list[tuple[Rgb, str]] = [(colour, f"an instance, {lines.side}")]
    if not np.array_equal(np.asarray(lines.selected) & lines.valid, lines.valid):
        found.append((theme.unselected, "not selected"))
    if lines.cursor is not None:
        found.append((theme.cursor, f"instance {lines.cursor}"))
    return found
