"""The overview on paper: a row per run with intervals, gap and baseline, and instances as lines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from s2rstore.metrics.bootstrap import LEVEL_TEXT
from s2rtui.canvas import LIGHT, Rgb, Theme
from s2rtui.charts.overview.lines import MANY, levels, pair_counts
from s2rtui.charts.overview.model import (
    OverviewLines,
    OverviewModel,
    cursor_accuracies,
    overview_model,
)
from s2rtui.charts.scene import OverviewRow
from s2rtui.charts.shared.axis_scale import Interval
from s2rtui.charts.shared.paper import (
    Page,
    Pixels,
    draw_heading,
    figure_bytes,
    make_page,
    new_figure,
    rgb_fractions,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patheffects import AbstractPathEffect

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

NUMBERS = 2.75
"""Width of the numbers at the right, inches."""


def overview_figure(
    rows: Sequence[OverviewRow],
    baseline: float | None,
    size: Pixels = (1600, 900),
    theme: Theme = LIGHT,
    selected: int | None = None,
    title: str = "Accuracy in simulation and in reality",
    subtitle: str = "",
    lines: OverviewLines | None = None,
) -> bytes:
    """Draw the figure in `size` pixels; the row `selected` is highlighted.

    With `lines` every instance is a line across the runs, the selected in their side's colour.
    """
    page = make_page(size, theme)
    model = overview_model(rows, baseline, lines)
    figure = new_figure(page)
    top = draw_heading(figure, page, title, subtitle)
    wide, _ = page.inches
    longest = max((len(row.run) for row in model.rows), default=4)
    left = min(0.4 + 0.085 * min(longest, 32), wide * 0.35)
    right = min(NUMBERS, wide * 0.32)
    across, keyed = _legend_size(wide, lines)
    box = page.box(left, 0.62, wide - left - right, top - 0.62 - keyed)
    axes = figure.add_axes(box)
    style_axes(axes, theme, grid=True)
    axes.spines["left"].set_visible(False)
    count = max(1, len(model.rows))
    axes.set_ylim(count - 0.5, -0.5)
    low, high = (100 * end for end in model.axis)
    axes.set_xlim(low - 0.02 * (high - low), high + 0.02 * (high - low))
    axes.set_xlabel("accuracy (%)")
    axes.set_yticks([])
    if lines is not None:
        draw_lines(axes, lines, model.axis, theme)
    for index, row in enumerate(model.rows):
        _row(axes, index, row, page, index == selected)
    _columns(axes, model, page, selected)
    _legend(figure, axes, model, page, (top, across), lines)
    return figure_bytes(figure, page)


def _row(axes: Axes, y: int, row: OverviewRow, page: Page, selected: bool) -> None:
    theme = page.theme
    if selected:
        from matplotlib.patches import Rectangle

        low, high = axes.get_xlim()
        span = high - low
        ground = Rectangle((low - 9 * span, y - 0.5), 19 * span, 1, linewidth=0, zorder=0)
        ground.set_color(rgb_fractions(theme.highlight))
        ground.set_clip_on(False)
        axes.add_patch(ground)
    _name(axes, y, row, page, selected)
    sides = (
        (row.sim_accuracy, row.sim_interval, theme.sim, rgb_fractions(theme.sim)),
        (row.real_accuracy, row.real_interval, theme.real, rgb_fractions(theme.background)),
    )
    if row.sim_accuracy is not None and row.real_accuracy is not None:
        ends = [100 * row.sim_accuracy, 100 * row.real_accuracy]
        axes.plot(
            ends,
            [y, y],
            color=rgb_fractions(theme.faint),
            linewidth=5,
            solid_capstyle="butt",
            zorder=2,
        )
    for accuracy, interval, colour, face in sides:
        ink = rgb_fractions(colour)
        if interval is not None:
            ends = [100 * interval[0], 100 * interval[1]]
            axes.plot(ends, [y, y], color=ink, linewidth=1.3, marker="|", markersize=6, zorder=3)
        if accuracy is not None:
            axes.plot(
                [100 * accuracy],
                [y],
                marker="D",
                markersize=8,
                markerfacecolor=face,
                markeredgecolor=ink,
                markeredgewidth=1.6,
                zorder=4,
            )


def _name(axes: Axes, y: int, row: OverviewRow, page: Page, selected: bool) -> None:
    """The name of the run, and its note where it has no accuracy."""
    theme = page.theme
    name = row.run if len(row.run) <= 32 else row.run[:31] + "…"
    label = axes.annotate(
        name,
        (0, y),
        xycoords=("axes fraction", "data"),
        xytext=(-10, 0),
        textcoords="offset points",
        ha="right",
        va="center",
        fontsize=10,
    )
    label.set_color(rgb_fractions(theme.text))
    label.set_fontweight("bold" if selected else "normal")
    if row.sim_accuracy is None and row.real_accuracy is None:
        axes.annotate(
            row.note or "n/a",
            (0.02, y),
            xycoords=("axes fraction", "data"),
            va="center",
            fontsize=9,
            color=rgb_fractions(theme.muted),
            bbox={"facecolor": rgb_fractions(theme.background), "edgecolor": "none", "pad": 2},
            zorder=5,
        )


def _columns(axes: Axes, model: OverviewModel, page: Page, selected: int | None) -> None:
    """The columns of numbers at the right: sim, real, gap (percent) and n."""
    theme = page.theme
    spots = (46, 92, 138, 180)
    names = (("sim", theme.sim), ("real", theme.real), ("gap", theme.muted), ("n", theme.muted))
    squeeze = min(1.0, min(NUMBERS, page.inches[0] * 0.32) / NUMBERS)

    def put(x: float, y: float, text: str, ink: tuple[int, int, int], bold: bool) -> None:
        label = axes.annotate(
            text,
            (1, y),
            xycoords=("axes fraction", "data"),
            xytext=(x * squeeze, 0),
            textcoords="offset points",
            ha="right",
            va="center",
            fontsize=10 * max(squeeze, 0.6),
        )
        label.set_color(rgb_fractions(ink))
        label.set_fontweight("bold" if bold else "normal")

    for spot, (name, ink) in zip(spots, names, strict=True):
        label = axes.annotate(
            name,
            (1, 1),
            xycoords="axes fraction",
            xytext=(spot * squeeze, 12),
            textcoords="offset points",
            ha="right",
            va="center",
            fontsize=9 * max(squeeze, 0.6),
        )
        label.set_color(rgb_fractions(ink))
    for y, row in enumerate(model.rows):
        sim, real = row.sim_accuracy, row.real_accuracy
        gap = None if sim is None or real is None else sim - real
        texts = [_percent(sim), _percent(real), _percent(gap), _size(row.n)]
        for spot, text, (_, ink) in zip(spots, texts, names, strict=True):
            put(spot, y, text, ink if text != "n/a" else theme.muted, y == selected)


def _size(n: int) -> str:
    """A count in at most five characters."""
    if n >= 1_000_000:
        return f"{n / 1e6:.1f}M"
    return f"{n // 1000}k" if n >= 100_000 else str(n) if n else "–"


def _percent(value: float | None) -> str:
    return "n/a" if value is None else f"{100 * value:.1f}".replace("-", "−")


def _diamonds(theme: Theme) -> list[Line2D]:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=rgb_fractions(theme.sim)),
        Line2D(
            [], [], color=rgb_fractions(theme.real), markerfacecolor=rgb_fractions(theme.background)
        ),
    ]
    for handle in handles:
        handle.set(linestyle="none", marker="D", markersize=7, markeredgewidth=1.6)
    return handles


def _legend_size(wide: float, lines: OverviewLines | None) -> tuple[int, float]:
    """The columns of the legend on a page `wide` inches wide, and its height in inches."""
    line_keys = 4 if lines is None else 7
    fit = 7 if wide > 8.5 else 4 if wide > (5 if lines is None else 6) else 3 if wide > 4 else 2
    across = min(fit, line_keys)
    return across, 0.4 + 0.22 * -(-line_keys // across)


def _legend(
    figure: Figure,
    axes: Axes,
    model: OverviewModel,
    page: Page,
    place: tuple[float, int],
    lines: OverviewLines | None,
) -> None:
    """Draw the legend; `place`: its top in inches above the page's foot, and its columns."""
    from matplotlib.lines import Line2D

    theme = page.theme
    handles = _diamonds(theme)
    handles.append(
        Line2D([], [], color=rgb_fractions(theme.muted), linewidth=1.3, marker="|", markersize=6)
    )
    names = ["sim", "real", f"{LEVEL_TEXT} interval"]
    if model.baseline is not None:
        line = axes.axvline(
            100 * model.baseline,
            color=rgb_fractions(theme.truth),
            linewidth=1.4,
            linestyle=(0, (2, 2)),
        )
        line.set_zorder(1.5)
        handles.append(line)
        names.append(f"constant mean position ({_percent(model.baseline)} %)")
    for ink, name in line_keys(lines, theme):
        handles.append(Line2D([], [], color=rgb_fractions(ink), linewidth=1.2))
        names.append(name)
    legend = figure.legend(
        handles,
        names,
        loc="upper left",
        bbox_to_anchor=(0.17 / page.inches[0], place[0] / page.inches[1]),
        ncols=place[1],
        frameon=False,
        fontsize=9 if page.inches[0] > 6 else 7,
        handletextpad=0.4,
        columnspacing=1.4,
        borderaxespad=0,
    )
    for text in legend.get_texts():
        text.set_color(rgb_fractions(theme.muted))


CLEAR = 60
"""Up to this number, selected lines are drawn in full strength; more are paler."""


FINE, COARSE = 200, 100
"""Bins of an accuracy axis: for single lines, and for densities of many."""


def draw_lines(axes: Axes, lines: OverviewLines, axis: Interval, theme: Theme) -> None:
    """Draw unselected lines in grey, selected ones in colour, the cursor's on top."""
    size = COARSE if len(lines.valid) > MANY else FINE
    pairs = pair_counts(lines, axis, size)
    colour = theme.sim if lines.side == "sim" else theme.real
    highlighted = int(np.count_nonzero(np.asarray(lines.selected) & lines.valid))
    for part, ink, order, strength in (
        (1, theme.unselected, 1.0, 0.45),
        (0, colour, 1.2, 0.75 * min(1.0, max(0.3, math.sqrt(CLEAR / max(highlighted, 1))))),
    ):
        peak = max((float(pair[part].max()) for pair in pairs), default=0.0)
        for row, pair in enumerate(pairs):
            _draw_segments(axes, pair[part], axis, row, (peak, strength), ink, order)
    if lines.cursor is not None:
        _draw_cursor_line(axes, lines, axis, theme)


def _draw_segments(
    axes: Axes,
    counts: NDArray[np.intp],
    axis: Interval,
    row: int,
    scale: tuple[float, float],
    ink: Rgb,
    order: float,
) -> None:
    """Segments from run `row` to the next one; `scale`: (peak count, its opacity)."""
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
    colours[:, :3] = rgb_fractions(ink)
    colours[:, 3] = scale[1] * (0.25 + 0.75 * shares) if scale[0] < 100 else scale[1] * shares
    segments = np.stack([starts, ends], axis=1)[ordered]
    collection = LineCollection(
        list(segments), colors=list(map(tuple, colours[ordered])), linewidths=0.7, zorder=order
    )
    axes.add_collection(collection)


def _draw_cursor_line(axes: Axes, lines: OverviewLines, axis: Interval, theme: Theme) -> None:
    """The cursor's line: a ring with a number per run, joined where known."""
    from matplotlib import patheffects

    accuracies = cursor_accuracies(lines)
    known = np.array([np.nan if value is None else value for value in accuracies])
    places = 100 * np.clip(known, *axis)
    rows = np.arange(len(known))
    ink = rgb_fractions(theme.cursor)
    axes.plot(places, rows, color=ink, linewidth=1.4, zorder=3.5)
    axes.scatter(
        places,
        rows,
        s=34,
        facecolors=[rgb_fractions(theme.background)],
        edgecolors=[ink],
        zorder=3.6,
    )
    halo: list[AbstractPathEffect] = [
        patheffects.withStroke(linewidth=2, foreground=rgb_fractions(theme.background))
    ]
    for place, row, value in zip(places.tolist(), rows.tolist(), accuracies, strict=True):
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


def line_keys(lines: OverviewLines | None, theme: Theme) -> list[tuple[Rgb, str]]:
    """Colours and names of the lines for the legend."""
    if lines is None:
        return []
    colour = theme.sim if lines.side == "sim" else theme.real
    keys: list[tuple[Rgb, str]] = [(colour, f"an instance, {lines.side}")]
    if not np.array_equal(np.asarray(lines.selected) & lines.valid, lines.valid):
        keys.append((theme.unselected, "not selected"))
    if lines.cursor is not None:
        keys.append((theme.cursor, f"instance {lines.cursor}"))
    return keys
