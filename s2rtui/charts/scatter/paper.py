"""Sim error against real error on paper."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from s2rtui.canvas import LIGHT, Theme
from s2rtui.charts.scatter.axis import LOG_RULE, ErrorAxis
from s2rtui.charts.scatter.model import (
    PERCENT,
    QUADRANTS,
    ScatterInput,
    ScatterModel,
    scatter_model,
)
from s2rtui.charts.shared.base_map_paper import LegendMark, marker_legend
from s2rtui.charts.shared.points_paper import cells_with_dots, paper_points
from s2rtui.drawing.page import (
    NARROW,
    Page,
    Pixels,
    draw_ring,
    label_with_unit,
    new_page,
    own_settings,
    style_axes,
    value_colours,
)
from s2rtui.drawing.scale import Floats, short_number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh

SIDE = 2.35
"""Inches at the right that the legend takes."""
BELOW = 3.9
"""Inches below the drawing that they take on a narrow page."""
BAR = 1.5
"""Height of the colour bar of a density with its title, inches."""
SIM_MARKER, REAL_MARKER = "D", "o"
"""Markers of instances by the larger of their errors."""
PER_INCH = 24
"""Cells per inch of a density."""


@own_settings()
def scatter_figure(
    data: ScatterInput, size: Pixels, theme: Theme = LIGHT, title: str = "", subtitle: str = ""
) -> bytes:
    """Draw the figure in `size` pixels; both axes have the same scale."""
    page = new_page(size, theme, title, subtitle)
    wide, left, foot = page.inches[0], 0.75, 0.6
    side = SIDE if wide > NARROW else 0.15
    is_below = wide <= NARROW and page.is_paper
    below = BELOW if is_below else 0.0
    edge = max(0.3, min(wide - left - side, page.top - foot - 0.15 - below))
    axes = page.axes(left, page.top - 0.1 - edge, edge, edge)
    cells = max(4, int(edge * PER_INCH))
    model = scatter_model(data, cells, cells)
    _style(axes, page, data, model)
    _lines(axes, page, model)
    corner = (left + edge + 0.3, page.top - 0.1)
    if is_below:
        corner = (0.35, page.top - 0.1 - edge - foot)
    if model.dense:
        _density(axes, page, model, corner)
    else:
        _points(axes, page, data)
    if model.cursor is not None:
        low = model.plane.axis.low
        at = [max(float(errors[model.cursor]), low) for errors in (data.sim, data.real)]
        draw_ring(axes, at[0], at[1], page.inks.cursor, 80, 8)
    if side > 1 or is_below:
        under = BAR + 0.2 if model.dense else 0.0
        _legend(page, data, model, (corner[0], corner[1] - under))
    return page.encoded()


def _style(axes: Axes, page: Page, data: ScatterInput, model: ScatterModel) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

    plane = model.plane
    style_axes(axes, page)
    for axis, ticks, scaled, limits in (
        (plane.across, axes.xaxis, axes.set_xscale, axes.set_xlim),
        (plane.up, axes.yaxis, axes.set_yscale, axes.set_ylim),
    ):
        scaled("log" if axis.log else "linear")
        limits(axis.low, axis.high)
        few = axis.log and np.log10(axis.high / axis.low) < 2.5
        subs = (1.0, 2.0, 5.0) if few and page.inches[0] > NARROW else (1.0,)
        ticks.set_major_locator(LogLocator(subs=subs) if axis.log else MaxNLocator(nbins=7))
        ticks.set_minor_locator(NullLocator())
        ticks.set_major_formatter(FuncFormatter(lambda value, _: short_number(value)))
    axes.set_xlabel(label_with_unit("sim error", data.unit))
    axes.set_ylabel(label_with_unit("real error", data.unit))
    for spine in axes.spines.values():
        spine.set_visible(True)


def _lines(axes: Axes, page: Page, model: ScatterModel) -> None:
    """The diagonal, and the limits of the best and the worst 15 % of each side."""
    inks, axis = page.inks, model.plane.axis
    ends = [axis.low, axis.high]
    axes.plot(ends, ends, color=inks.muted, linewidth=1.0, zorder=2)
    dashed = (0, (4, 3))
    for limits, draw in ((model.summary.sim, axes.axvline), (model.summary.real, axes.axhline)):
        for limit in (limits.best, limits.worst):
            if np.isfinite(limit):
                at = max(limit, axis.low)
                draw(at, color=inks.muted, linewidth=0.8, linestyle=dashed, zorder=2)


def _points(axes: Axes, page: Page, data: ScatterInput) -> None:
    """Unselected points small and grey, the selected in the colour of the larger error."""
    inks, axis = page.inks, data.axis
    sim, real = (_shown(errors, axis) for errors in (data.sim, data.real))
    points = paper_points(axes, inks, sim, real, data)
    points.draw_unselected(7, 3)
    selected = points.members
    edge = [inks.background]
    for larger, ink, marker in (
        (real > sim, inks.real, REAL_MARKER), (sim > real, inks.sim, SIM_MARKER),
        (sim == real, inks.text, REAL_MARKER),
    ):  # fmt: skip
        part = selected[larger[selected]]
        axes.scatter(
            sim[part], real[part], s=24, color=ink, marker=marker, edgecolors=edge, linewidths=0.5,
            zorder=5, alpha=0.85,
        )  # fmt: skip
    points.draw_holes(6, 6)


def _shown(errors: Floats, axis: ErrorAxis) -> Floats:
    """Errors as they are drawn: those below a logarithmic axis lie at its end."""
    values = np.asarray(errors, dtype=np.float64)
    return np.maximum(values, axis.low) if axis.log else values


def _density(axes: Axes, page: Page, model: ScatterModel, corner: tuple[float, float]) -> None:
    """Cells in the colour of the number of selected instances, and a colour bar at `corner`."""
    from matplotlib.colors import ListedColormap, LogNorm

    rows, columns = model.count.shape
    across, up = (
        [axis.value(place / cells) for place in range(cells + 1)]
        for axis, cells in ((model.plane.across, columns), (model.plane.up, rows))
    )
    grey = cells_with_dots(model.grey)
    shade = np.ma.masked_where(~grey, np.ones(grey.shape))
    axes.pcolormesh(
        across, up, shade[::-1], cmap=ListedColormap([page.inks.unselected]), alpha=0.6, zorder=1,
        linewidth=0, rasterized=True,
    )  # fmt: skip
    counts = np.ma.masked_equal(model.count[::-1], 0)
    norm = LogNorm(1, max(model.peak, 2))
    colours = ListedColormap(value_colours(np.linspace(0, 1, 256)) / 255.0)
    mesh = axes.pcolormesh(
        across, up, counts, cmap=colours, norm=norm, zorder=1.5, linewidth=0, rasterized=True
    )
    if page.inches[0] > NARROW or page.is_paper:
        _count_bar(page, mesh, model.peak, corner)


def _count_bar(page: Page, mesh: QuadMesh, peak: int, corner: tuple[float, float]) -> None:
    """The colour bar of a density, with its upper left end `corner` (inches)."""
    from matplotlib.ticker import FixedLocator, FuncFormatter

    left, top = corner
    axes = page.axes(left, top - BAR, 0.16, BAR - 0.2)
    bar = page.figure.colorbar(mesh, cax=axes)
    bar.outline.set_visible(False)
    powers = [10**power for power in range(len(str(peak))) if 10**power <= 0.6 * peak]
    bar.locator = FixedLocator([*powers, peak])
    bar.formatter = FuncFormatter(lambda count, _: f"{count:.0f}")
    bar.update_ticks()
    axes.minorticks_off()
    axes.tick_params(colors=page.inks.muted, labelsize=8, width=0.8, length=3)
    axes.set_title("instances per cell", loc="left", fontsize=9, pad=6, color=page.inks.text)


def _legend(
    page: Page, data: ScatterInput, model: ScatterModel, corner: tuple[float, float]
) -> None:
    summary, inks = model.summary, page.inks
    marks: list[LegendMark] = [
        (f"real error larger: {summary.real_larger}", REAL_MARKER, inks.real, True),
        (f"sim error larger: {summary.sim_larger}", SIM_MARKER, inks.sim, True),
    ]
    if model.dense:
        marks = [(name, "", ink, filled) for name, _, ink, filled in marks]
    if data.trained is not None and not model.dense:
        marks.append(("hole: trained on", "o", inks.text, False))
    if summary.selected < summary.total:
        marks.append(("not selected", ".", inks.unselected, True))
    if model.cursor is not None:
        marks.append((f"instance {model.cursor}", "o", inks.cursor, False))
    marks.append((f"dashed: best and worst {PERCENT} % of {summary.total}", "", inks.text, False))
    marks += [
        (f"{quadrant.name}: {total}", "", inks.text, False)
        for quadrant, (total, _) in zip(QUADRANTS, summary.quadrants, strict=True)
    ]
    if data.axis.log:
        marks.append((f"log axes: {LOG_RULE}", "", inks.muted, False))
    if summary.below:
        text = f"{summary.below} below {short_number(data.axis.low)} {data.unit} at the edge"
        marks.append((text, "", inks.muted, False))
    marker_legend(page, marks, corner)
