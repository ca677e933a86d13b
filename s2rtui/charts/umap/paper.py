"""The embeddings on paper: sim and real with the same axes and colours."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from s2rtui.canvas import LIGHT, Theme
from s2rtui.charts.shared.points_paper import cells_with_dots, paper_points
from s2rtui.charts.umap.model import (
    UmapInput,
    UmapLayer,
    UmapModel,
    level_shares,
    umap_frame,
    umap_model,
    umap_values,
)
from s2rtui.drawing.page import (
    NARROW,
    SMALLEST,
    Ink,
    Inks,
    Page,
    Pixels,
    draw_colour_bar,
    draw_ring,
    label_with_unit,
    new_page,
    own_settings,
    set_panel_title,
    style_plane,
    value_colours,
    wrapped_label,
)
from s2rtui.drawing.scale import Floats, scale_fraction

if TYPE_CHECKING:
    from matplotlib.axes import Axes

POINTS_UP_TO = 40_000
"""Above this number of valid instances, cells are drawn in the colour of their mean."""
SIDE = 1.4
"""Inches at the right that colour bar and legend take."""
BELOW = 1.5
"""Inches that they take below the panels of a narrow page."""
TALLEST = 1.25
"""A panel's height over its width, at most."""


@own_settings()
def umap_figure(
    data: UmapInput, size: Pixels, theme: Theme = LIGHT, title: str = "", subtitle: str = ""
) -> bytes:
    """Draw the figure in `size` pixels: sim, real and a colour bar."""
    page = new_page(size, theme, title, subtitle)
    wide, _ = page.inches
    side, below = (SIDE, 0.0) if wide > NARROW else (0.1, BELOW)
    width, height = (wide - 0.65 - side - 0.35) / 2, page.top - 0.55 - 0.35 - below
    foot = 0.55 + below + max(0.0, height - TALLEST * width)
    height = min(height, TALLEST * width)
    model = umap_model(data, umap_frame(data, max(1, int(width * 60)), max(1, int(height * 30))))
    for index, name in enumerate(("sim", "real")):
        axes = page.axes(0.65 + index * (width + 0.35), foot, width, height)
        _draw_panel(axes, data, model, name, page, (width, height))
        if index:
            axes.tick_params(labelleft=False)
        else:
            axes.set_ylabel("v (no unit)")
    if side > 1:
        _draw_side(page, data, model, (wide - side + 0.25, foot + height))
    elif wide > SMALLEST:
        _draw_side(page, data, model, (0.4, foot - 0.75), below=True)
    return page.encoded()


def _draw_side(
    page: Page,
    data: UmapInput,
    model: UmapModel,
    corner: tuple[float, float],
    below: bool = False,
) -> None:
    """The colour bar and what the other marks mean, from `corner` (inches) downwards.

    The marks are under the bar, or at its right where all this is below the panels.
    """
    from matplotlib.lines import Line2D

    (left, top), inks, (wide, high) = corner, page.inks, page.inches
    bar = 0.9 if below else min(2.0, top * 0.45)
    label = wrapped_label(label_with_unit(data.value_label, data.value_unit), 14)
    clipped = data.value_range is None
    draw_colour_bar(
        page, left, top - bar - 0.15, bar, model.value_range, label, value_colours, clipped
    )
    y = top - bar - 0.5
    if below:
        left, y = left + 1.5, top - 0.2
    dots: list[tuple[str, Ink, float, Ink | str, float]] = []
    if model.sim.selected < model.sim.total:
        dots.append(("not selected", inks.unselected, 4.0, inks.unselected, 0.0))
    if data.trained is not None:
        dots.append(("trained on", inks.text, 6.0, "none", 1.6))
    if model.cursor is not None:
        dots.append((f"instance {model.cursor}", inks.cursor, 8.0, "none", 1.6))
    for text, ink, size, face, edge in dots:
        dot = Line2D(
            [(left + 0.08) / wide], [y / high], marker="o", markersize=size, color=ink,
            markerfacecolor=face, markeredgewidth=edge,
        )  # fmt: skip
        page.figure.add_artist(dot)
        page.text(left + 0.25, y, text, inks.text, 8.5, va="center")
        y -= 0.26


def _draw_panel(
    axes: Axes,
    data: UmapInput,
    model: UmapModel,
    name: str,
    page: Page,
    inches: tuple[float, float],
) -> None:
    area = model.frame.extent
    style_plane(axes, page, (area.x0, area.x1, area.y0, area.y1), inches)
    axes.set_xlabel("u (no unit)")
    sim = name == "sim"
    layer = model.sim if sim else model.real
    counts = f"{layer.selected} of {layer.total}" if layer.total else "none"
    title = f"{name}   {counts}" if page.inches[0] > NARROW else name
    set_panel_title(axes, title, getattr(page.inks, name))
    points = np.asarray(data.sim if sim else data.real, dtype=np.float64)
    if layer.total > POINTS_UP_TO:
        _draw_cells(axes, model, layer, page.inks)
    else:
        _draw_points(axes, data, points, model, page.inks)
    if model.cursor is not None and np.isfinite(points[model.cursor]).all():
        x, y = points[model.cursor]
        draw_ring(axes, x, y, page.inks.cursor, 80, 6)


def _draw_points(axes: Axes, data: UmapInput, points: Floats, model: UmapModel, inks: Inks) -> None:
    """Unselected points small and grey, the selected by value, the largest on top."""
    layers = paper_points(axes, inks, points[:, 0], points[:, 1], data)
    layers.draw_unselected(6, 2)
    highlighted = layers.members
    shares = scale_fraction(umap_values(data), model.value_range)[highlighted]
    order = np.argsort(np.nan_to_num(shares, nan=-1.0), kind="stable")
    shares = shares[order]
    colours = value_colours(shares) / 255.0
    colours[~np.isfinite(shares)] = inks.muted
    (x, y), edge = points[highlighted[order]].T, [inks.background]
    axes.scatter(x, y, s=24, c=colours, edgecolors=edge, linewidths=0.5, zorder=4)
    layers.draw_holes(8, 5)


def _draw_cells(axes: Axes, model: UmapModel, layer: UmapLayer, inks: Inks) -> None:
    """The cells of the model as an image."""
    area, (rows, columns) = model.frame.extent, layer.level.shape
    image = np.zeros((rows, columns, 4))
    image[cells_with_dots(layer.grey)] = (*inks.unselected, 0.6)
    colours = np.vstack([np.array([inks.muted]), value_colours(level_shares()) / 255.0])
    highlighted = layer.level >= 0
    image[highlighted, :3] = colours[layer.level[highlighted]]
    image[highlighted, 3] = 1.0
    extent = (area.x0, area.x1, area.y0, area.y1)
    axes.imshow(image, extent=extent, origin="upper", interpolation="nearest", aspect="auto")
