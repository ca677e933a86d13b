"""The embeddings on paper: sim and real with the same axes and colours."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from s2rtui.analysis.binning import selection_indices
from s2rtui.canvas import LIGHT, Theme, turbo
from s2rtui.charts.shared.axis_scale import Floats, scale_fraction, tick_values
from s2rtui.charts.shared.paper import (
    Page,
    Pixels,
    draw_colour_bar,
    draw_heading,
    figure_bytes,
    make_page,
    new_figure,
    rgb_fractions,
    style_axes,
)
from s2rtui.charts.umap.model import (
    UmapInput,
    UmapModel,
    level_shares,
    umap_frame,
    umap_model,
    umap_values,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POINTS_UP_TO = 40_000
"""Above this number of valid instances, cells are drawn in the colour of their mean."""
SIDE = 1.4
"""Inches at the right that colour bar and legend take."""
TALLEST = 1.25
"""A panel's height over its width, at most."""


def umap_figure(
    data: UmapInput,
    size: Pixels = (1600, 800),
    theme: Theme = LIGHT,
    title: str = "Embeddings in simulation and in reality",
    subtitle: str = "",
) -> bytes:
    """Draw the figure in `size` pixels: sim, real and a colour bar."""
    page = make_page(size, theme)
    figure = new_figure(page)
    top = draw_heading(figure, page, title, subtitle)
    wide, _ = page.inches
    side = SIDE if wide > 4.5 else 0.1
    width, height = (wide - 0.65 - side - 0.35) / 2, top - 0.55 - 0.35
    foot = 0.55 + max(0.0, height - TALLEST * width)
    height = min(height, TALLEST * width)
    model = umap_model(data, umap_frame(data, max(1, int(width * 60)), max(1, int(height * 30))))
    for index, name in enumerate(("sim", "real")):
        box = page.box(0.65 + index * (width + 0.35), foot, width, height)
        axes = figure.add_axes(box)
        _panel(axes, data, model, name, page, (width, height))
        if index:
            axes.tick_params(labelleft=False)
        else:
            axes.set_ylabel("v")
    if side > 1:
        _side(figure, page, data, model, (wide - side + 0.25, foot + height))
    return figure_bytes(figure, page)


def _side(
    figure: Figure, page: Page, data: UmapInput, model: UmapModel, corner: tuple[float, float]
) -> None:
    """The colour bar, and under it what the other marks mean, from `corner` (inches) downwards."""
    from matplotlib.lines import Line2D

    left, top = corner
    high = min(2.0, top * 0.45)
    label = f"{data.value_label} ({data.value_unit})" if data.value_unit else data.value_label
    box = page.box(left, top - high - 0.15, 0.16, high)
    draw_colour_bar(figure, page, box, model.value_range, label, turbo)
    marks = []
    if model.sim.selected < model.sim.total:
        marks.append(("not selected", page.theme.unselected, 4.0))
    if model.cursor is not None:
        marks.append((f"instance {model.cursor}", page.theme.cursor, 8.0))
    y = top - high - 0.5
    for text, ink, size in marks:
        spot = ((left + 0.08) / page.inches[0], y / page.inches[1])
        dot = Line2D([spot[0]], [spot[1]], marker="o", markersize=size, color=rgb_fractions(ink))
        dot.set_markerfacecolor(rgb_fractions(ink) if size < 5 else "none")
        dot.set_markeredgewidth(0 if size < 5 else 1.6)
        figure.add_artist(dot)
        panel_title = figure.text(
            spot[0] + 0.17 / page.inches[0], spot[1], text, va="center", fontsize=8.5
        )
        panel_title.set_color(rgb_fractions(page.theme.text))
        y -= 0.26


def _panel(
    axes: Axes,
    data: UmapInput,
    model: UmapModel,
    name: str,
    page: Page,
    inches: tuple[float, float],
) -> None:
    theme, area = page.theme, model.frame.extent
    style_axes(axes, theme)
    axes.set_xlim(area.x0, area.x1)
    axes.set_ylim(area.y0, area.y1)
    axes.set_xticks(tick_values(area.x0, area.x1, max(2, int(inches[0] / 0.7))))
    axes.set_yticks(tick_values(area.y0, area.y1, max(2, int(inches[1] / 0.7))))
    axes.set_xlabel("u")
    for spine in axes.spines.values():
        spine.set_visible(True)
    sim = name == "sim"
    layer = model.sim if sim else model.real
    panel_title = f"{name}   {layer.selected} of {layer.total}" if layer.total else f"{name}   none"
    label = axes.set_title(panel_title, loc="left", fontsize=10, pad=6)
    label.set_color(rgb_fractions(theme.sim if sim else theme.real))
    label.set_fontweight("bold")
    points = np.asarray(data.sim if sim else data.real, dtype=np.float64)
    if layer.total > POINTS_UP_TO:
        _cells(axes, model, name, theme)
    else:
        _points(axes, data, points, model, theme)
    if model.cursor is not None and np.isfinite(points[model.cursor]).all():
        x, y = points[model.cursor]
        ink = rgb_fractions(theme.cursor)
        axes.scatter([x], [y], s=80, facecolors="none", edgecolors=[ink], linewidths=1.6, zorder=6)


def _points(axes: Axes, data: UmapInput, points: Floats, model: UmapModel, theme: Theme) -> None:
    """Unselected points small and grey, the selected by value, the largest on top."""
    highlighted = selection_indices(data.selected, data.valid).members
    others = np.asarray(data.valid, dtype=np.bool_).copy()
    others[highlighted] = False
    grey = points[others]
    axes.scatter(
        grey[:, 0], grey[:, 1], s=6, color=rgb_fractions(theme.unselected), linewidths=0, zorder=2
    )
    shares = scale_fraction(umap_values(data), model.value_range)[highlighted]
    order = np.argsort(np.nan_to_num(shares, nan=-1.0), kind="stable")
    shares, points_on_top = shares[order], points[highlighted[order]]
    ink = turbo(shares) / 255.0
    ink[~np.isfinite(shares)] = rgb_fractions(theme.muted)
    edge = [rgb_fractions(theme.background)]
    axes.scatter(
        points_on_top[:, 0],
        points_on_top[:, 1],
        s=24,
        c=ink,
        edgecolors=edge,
        linewidths=0.5,
        zorder=4,
    )


def _cells(axes: Axes, model: UmapModel, name: str, theme: Theme) -> None:
    """The cells of the model as a picture."""
    layer, area = (model.sim if name == "sim" else model.real), model.frame.extent
    rows, columns = layer.level.shape
    picture = np.zeros((rows, columns, 4))
    grey = layer.grey.reshape(rows, 4, columns, 2).any(axis=(1, 3))
    picture[grey] = (*rgb_fractions(theme.unselected), 0.6)
    inks = np.vstack([np.array([theme.muted]), turbo(level_shares())]) / 255.0
    highlighted = layer.level >= 0
    picture[highlighted, :3] = inks[layer.level[highlighted]]
    picture[highlighted, 3] = 1.0
    axes.imshow(
        picture,
        extent=(area.x0, area.x1, area.y0, area.y1),
        origin="upper",
        interpolation="nearest",
        aspect="auto",
    )
