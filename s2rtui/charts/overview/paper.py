"""The overview on paper: a row per run with intervals, gap and baseline, and instances as lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.intervals import LEVEL_TEXT
from s2rtui.canvas import LIGHT, Theme
from s2rtui.charts.overview.bands import MOST_LINES, accuracy_quantiles
from s2rtui.charts.overview.lines import PALE, levels, pair_counts
from s2rtui.charts.overview.model import (
    OverviewLines,
    OverviewModel,
    cursor_accuracies,
    overview_model,
    selected_parts,
)
from s2rtui.charts.scene import OverviewRow
from s2rtui.drawing.page import NARROW, Ink, Page, Pixels, new_page, own_settings, style_axes
from s2rtui.drawing.scale import Interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NUMBERS = 2.75
"""Width of the numbers at the right, inches."""
FINE = 200
"""Bins of an accuracy axis."""


@own_settings()
def overview_figure(
    rows: Sequence[OverviewRow],
    baseline: float | None,
    size: Pixels,
    theme: Theme = LIGHT,
    selected: int | None = None,
    subtitle: str = "",
    lines: OverviewLines | None = None,
) -> bytes:
    """Draw the figure in `size` pixels; the row `selected` is highlighted.

    With `lines` every instance is a line across the runs, the selected in their side's colour;
    more than `MOST_LINES` are bands.
    """
    page = new_page(size, theme, "Accuracy in simulation and in reality", subtitle)
    model = overview_model(rows, baseline, lines)
    wide, _ = page.inches
    longest = max((len(row.run) for row in model.rows), default=4)
    left = min(0.4 + 0.085 * min(longest, 32), wide * 0.35)
    right = _numbers_width(page)
    across, legend_height = _legend_size(wide, lines)
    axes = page.axes(left, 0.62, wide - left - right, page.top - 0.62 - legend_height)
    style_axes(axes, page, grid=True)
    axes.spines["left"].set_visible(False)
    axes.set_ylim(max(1, len(model.rows)) - 0.5, -0.5)
    low, high = (100 * end for end in model.axis)
    axes.set_xlim(low - 0.02 * (high - low), high + 0.02 * (high - low))
    axes.set_xlabel("accuracy (%)")
    axes.set_yticks([])
    if lines is not None:
        draw_lines(axes, lines, model.axis, page)
    for index, row in enumerate(model.rows):
        _draw_row(axes, index, row, page, index == selected)
    _write_numbers(axes, model, page, selected)
    _draw_legend(axes, model, page, across, lines)
    return page.encoded()


def _draw_row(axes: Axes, y: int, row: OverviewRow, page: Page, selected: bool) -> None:
    inks = page.inks
    if selected:
        from matplotlib.patches import Rectangle

        low, high = axes.get_xlim()
        corner, width = (low - 9 * (high - low), y - 0.5), 19 * (high - low)
        ground = Rectangle(corner, width, 1, color=inks.highlight, linewidth=0, zorder=0)
        axes.add_patch(ground).set_clip_on(False)
    _write_name(axes, y, row, page, selected)
    if row.sim_accuracy is not None and row.real_accuracy is not None:
        ends, ink = [100 * row.sim_accuracy, 100 * row.real_accuracy], inks.faint
        axes.plot(ends, [y, y], color=ink, linewidth=5, solid_capstyle="butt", zorder=2)
    for accuracy, interval, ink, face in (
        (row.sim_accuracy, row.sim_interval, inks.sim, inks.sim),
        (row.real_accuracy, row.real_interval, inks.real, inks.background),
    ):
        if interval is not None:
            ends = [100 * interval[0], 100 * interval[1]]
            axes.plot(ends, [y, y], color=ink, linewidth=1.3, marker="|", markersize=6, zorder=3)
        if accuracy is not None:
            axes.plot(
                [100 * accuracy], [y], marker="D", markersize=8, markerfacecolor=face,
                markeredgecolor=ink, markeredgewidth=1.6, zorder=4,
            )  # fmt: skip


def _write_name(axes: Axes, y: int, row: OverviewRow, page: Page, selected: bool) -> None:
    """The name of the run, and its note where it has no accuracy."""
    inks = page.inks
    axes.annotate(
        row.run if len(row.run) <= 32 else row.run[:31] + "…", (0, y), xytext=(-10, 0),
        xycoords=("axes fraction", "data"), textcoords="offset points", ha="right", va="center",
        fontsize=10, color=inks.text, fontweight="bold" if selected else "normal",
    )  # fmt: skip
    if row.sim_accuracy is None and row.real_accuracy is None:
        box = {"facecolor": inks.background, "edgecolor": "none", "pad": 2}
        axes.annotate(
            row.note or "n/a", (0.02, y), xycoords=("axes fraction", "data"), va="center",
            fontsize=9, color=inks.muted, bbox=box, zorder=5,
        )  # fmt: skip


def _write_numbers(axes: Axes, model: OverviewModel, page: Page, selected: int | None) -> None:
    """The columns of numbers at the right: sim, real, gap (percent) and n."""
    inks = page.inks
    columns = (
        (46, "sim", inks.sim), (92, "real", inks.real), (138, "gap", inks.muted),
        (180, "n", inks.muted),
    )  # fmt: skip
    squeeze = min(1.0, _numbers_width(page) / NUMBERS)

    def put(
        x: int, y: int, text: str, ink: Ink, size: int, up: int, coordinates: object, weight: str
    ) -> None:
        axes.annotate(
            text, (1, y), xycoords=coordinates, xytext=(x * squeeze, up), ha="right", va="center",
            textcoords="offset points", fontsize=size * max(squeeze, 0.7), color=ink,
            fontweight=weight,
        )  # fmt: skip

    for x, name, ink in columns:
        put(x, 1, name, ink, 9, 12, "axes fraction", "normal")
    for y, row in enumerate(model.rows):
        sim, real = row.sim_accuracy, row.real_accuracy
        gap = None if sim is None or real is None else sim - real
        texts = (_percent(sim), _percent(real), _percent(gap), _short_count(row.n))
        weight = "bold" if y == selected else "normal"
        for (x, _, ink), text in zip(columns, texts, strict=True):
            ink = inks.muted if text == "n/a" else ink
            put(x, y, text, ink, 10, 0, ("axes fraction", "data"), weight)


def _numbers_width(page: Page) -> float:
    """Inches of the numbers at the right."""
    wide, _ = page.inches
    return min(NUMBERS, wide * (0.32 if wide > NARROW else 0.42))


def _short_count(n: int) -> str:
    """A count in at most five characters."""
    if n >= 1_000_000:
        return f"{n / 1e6:.1f}M"
    return f"{n // 1000}k" if n >= 100_000 else str(n) if n else "–"


def _percent(value: float | None) -> str:
    return "n/a" if value is None else f"{100 * value:.1f}".replace("-", "−")


def _legend_size(wide: float, lines: OverviewLines | None) -> tuple[int, float]:
    """The columns of the legend on a page `wide` inches wide, and its height in inches."""
    entries = 4 if lines is None else 7
    fit = 7 if wide > 8.5 else 4 if wide > (5 if lines is None else 6.5) else 3 if wide > 4 else 1
    across = min(fit, entries)
    return across, 0.4 + 0.22 * -(-entries // across)


def _draw_legend(
    axes: Axes, model: OverviewModel, page: Page, across: int, lines: OverviewLines | None
) -> None:
    """Draw the legend below the heading, in `across` columns."""
    from matplotlib.lines import Line2D

    inks, (wide, high) = page.inks, page.inches
    diamond: dict[str, Any] = {
        "linestyle": "none",
        "marker": "D",
        "markersize": 7,
        "markeredgewidth": 1.6,
    }
    handles = [
        Line2D([], [], color=inks.sim, **diamond),
        Line2D([], [], color=inks.real, markerfacecolor=inks.background, **diamond),
        Line2D([], [], color=inks.muted, linewidth=1.3, marker="|", markersize=6),
    ]
    names = ["sim", "real", f"{LEVEL_TEXT} interval"]
    if model.baseline is not None:
        at, dots = 100 * model.baseline, (0, (2, 2))
        handles.append(
            axes.axvline(at, color=inks.truth, linewidth=1.4, linestyle=dots, zorder=1.5)
        )
        names.append(f"constant mean position ({_percent(model.baseline)} %)")
    for ink, name in line_keys(lines, page):
        handles.append(Line2D([], [], color=ink, linewidth=1.2))
        names.append(name)
    page.figure.legend(
        handles, names, loc="upper left", bbox_to_anchor=(0.17 / wide, page.top / high),
        ncols=across, frameon=False, handletextpad=0.4, columnspacing=1.4,
        fontsize=9 if wide > 6.5 else 8 if wide > 6 else 7, borderaxespad=0, labelcolor=inks.muted,
    )  # fmt: skip


def draw_lines(axes: Axes, lines: OverviewLines, axis: Interval, page: Page) -> None:
    """Draw unselected instances in grey, selected ones in colour, the cursor's line on top.

    Each is a line, or all are bands where they are many (`OverviewLines.banded`).
    """
    valid, selected = (np.asarray(part, dtype=np.bool_) for part in (lines.valid, lines.selected))
    new, trained = selected_parts(lines)
    ink = getattr(page.inks, lines.side)
    layers = [(valid & ~selected, page.inks.unselected, 1.0, 0.45)]
    if trained is not None:
        layers.append((valid & trained.selected, _pale(ink, page), 1.1, 0.75))
    layers.append((valid & new.selected, ink, 1.2, 0.75))
    for members, colour, order, strength in layers:
        if np.count_nonzero(members) > MOST_LINES:
            _draw_bands(axes, accuracy_quantiles(lines.values, members), axis, colour, order)
            continue
        pairs = pair_counts(replace(lines, selected=members), axis, FINE)
        peak = max((float(highlighted.max()) for highlighted, _ in pairs), default=0.0)
        for row, (highlighted, _) in enumerate(pairs):
            _draw_segments(axes, highlighted, axis, row, (peak, strength), colour, order)
    if lines.cursor is not None:
        _draw_cursor_line(axes, lines, axis, page)


def _draw_bands(
    axes: Axes, quantiles: NDArray[np.float64], axis: Interval, ink: Ink, order: float
) -> None:
    """The outer and the inner band and the median of (runs, 5) accuracies, across the runs."""
    rows, places = np.arange(len(quantiles)), 100 * np.clip(quantiles, *axis)
    for left, right, opacity in ((0, 4, 0.16), (1, 3, 0.26)):
        axes.fill_betweenx(
            rows, places[:, left], places[:, right], color=ink, alpha=opacity, linewidth=0,
            zorder=order,
        )  # fmt: skip
    axes.plot(places[:, 2], rows, color=ink, linewidth=1.1, alpha=0.8, zorder=order + 0.1)


def _draw_segments(
    axes: Axes,
    counts: NDArray[np.intp],
    axis: Interval,
    row: int,
    scale: tuple[float, float],
    ink: Ink,
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
    segments = list(np.stack([starts, ends], axis=1)[ordered])
    opacity = scale[1] * (0.25 + 0.75 * shares)
    colours = [(*ink, alpha) for alpha in opacity[ordered].tolist()]
    axes.add_collection(LineCollection(segments, colors=colours, linewidths=0.7, zorder=order))


def _draw_cursor_line(axes: Axes, lines: OverviewLines, axis: Interval, page: Page) -> None:
    """The cursor's line: a ring with a number per run, joined where known."""
    accuracies = cursor_accuracies(lines)
    known = np.array([np.nan if value is None else value for value in accuracies])
    places, rows, ink = 100 * np.clip(known, *axis), np.arange(len(known)), page.inks.cursor
    axes.plot(places, rows, color=ink, linewidth=1.4, zorder=3.5)
    face = [page.inks.background]
    axes.scatter(places, rows, s=34, facecolors=face, edgecolors=[ink], zorder=3.6)
    for place, row, value in zip(places.tolist(), rows.tolist(), accuracies, strict=True):
        if value is not None:
            axes.annotate(
                f"{100 * value:.1f}", (place, row), xytext=(6, -9), textcoords="offset points",
                fontsize=7, zorder=6, color=ink, path_effects=page.halo(2),
            )  # fmt: skip


def _pale(ink: Ink, page: Page) -> Ink:
    """The ink of lines of trained instances."""
    red, green, blue = (
        PALE * part + (1 - PALE) * ground
        for part, ground in zip(ink, page.inks.background, strict=True)
    )
    return red, green, blue


def line_keys(lines: OverviewLines | None, page: Page) -> list[tuple[Ink, str]]:
    """Colours and names of the lines for the legend."""
    if lines is None:
        return []
    drawn = "bands" if lines.banded[0] else "an instance"
    keys = [(getattr(page.inks, lines.side), f"{drawn}, {lines.side}")]
    if lines.trained is not None:
        keys.append((_pale(keys[0][0], page), "a model was trained on it"))
    if not np.array_equal(np.asarray(lines.selected) & lines.valid, lines.valid):
        keys.append((page.inks.unselected, "not selected"))
    if lines.cursor is not None:
        keys.append((page.inks.cursor, f"instance {lines.cursor}"))
    return keys
