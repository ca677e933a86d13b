"""The geo-map on paper: floor plan, heat, poses, errors, with scales in metres."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from s2rstore.records import Bounds
from s2rtui.canvas.colour import LIGHT, Theme, luma, mix, turbo
from s2rtui.canvas.raster import resample
from s2rtui.figures.geomap_marks import draw_cursor, draw_points, draw_rooms, draw_scale
from s2rtui.figures.style import (
    Page,
    Pixels,
    colour_scale,
    dress,
    heading,
    new_figure,
    page_of,
    png,
    unit,
)
from s2rtui.plots.geomap_model import GeoMapModel, default_view, geomap_model
from s2rtui.plots.inputs import GeoMapInput
from s2rtui.plots.scale import fraction, ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIDE = 1.75
"""Inches at the right that colour bars and legend take."""


def geomap_figure(
    view: GeoMapInput,
    size: Pixels = (1600, 1200),
    theme: Theme = LIGHT,
    run: str = "",
    expression: str = "",
    title: str = "",
    viewport: Bounds | None = None,
) -> bytes:
    """A PNG of `size` pixels; the heading names the run, the expression and how many it lights."""
    page = page_of(size, theme)
    model = geomap_model(view)
    area = viewport or default_view(view)
    figure = new_figure(page)
    count = f"{int(model.lit.sum())} of {int(np.count_nonzero(view.valid))} instances"
    parts = [part for part in (expression, count) if part]
    top = heading(figure, page, title or _title(view, run), "  ·  ".join(parts))
    wide, _ = page.inches
    side = SIDE if wide > 4.5 else 0.0
    room = (max(wide - 0.75 - side - 0.2, 0.3), max(top - 0.6, 0.3))
    scale = min(room[0] / area.width, room[1] / area.height)
    width, height = area.width * scale, area.height * scale
    left = 0.75
    axes = figure.add_axes(page.box(left, top - height, width, height))
    _ground(axes, view, page, width)
    _axes(axes, view, area, page, (width, height))
    if view.rooms:
        draw_rooms(axes, view, theme)
    draw_points(axes, view, model, theme)
    draw_cursor(axes, view, model, theme, area)
    draw_scale(axes, area, view.y_down, theme)
    if side:
        _side(figure, page, view, model, (left + width + 0.3, top))
    return png(figure, page)


def _title(view: GeoMapInput, run: str) -> str:
    what = "predicted and true positions" if view.mode == "full" else view.value_label
    what = f"{what} and {view.heat_label}" if view.heat is not None else what
    return f"{run}: {what}" if run else what[:1].upper() + what[1:]


def _ground(axes: Axes, view: GeoMapInput, page: Page, inches: float) -> None:
    """Floor plan, paled towards the page, and the heat on it as one picture."""
    theme, bounds = page.theme, view.bounds
    if bounds.width <= 0 or bounds.height <= 0:
        return
    extent = (bounds.x0, bounds.x1, bounds.y0, bounds.y1)
    if view.floor_plan is not None:
        limit = max(16, int(inches * page.dpi))
        rows, columns = view.floor_plan.shape[:2]
        shrink = min(1.0, limit / max(rows, columns))
        floor = resample(view.floor_plan, int(rows * shrink), int(columns * shrink))
        grey = np.repeat((luma(floor) * 255)[..., None], 3, axis=-1)
        muted = 0.5 * floor + 0.5 * grey
        picture = mix(np.array(theme.background), muted, 0.5)
        if not view.y_down:
            picture = picture[::-1]
        axes.imshow(
            picture, extent=extent, origin="lower", interpolation="antialiased", aspect="auto"
        )
    if view.heat is not None and (scale := geomap_model(view).heat_range) is not None:
        shares = fraction(view.heat, scale)
        opacity = np.where(np.isfinite(shares), 0.15 + 0.7 * np.nan_to_num(shares) ** 0.7, 0.0)
        layer = np.dstack([turbo(shares) / 255.0, opacity])
        axes.imshow(layer, extent=extent, origin="lower", interpolation="nearest", aspect="auto")


def _axes(
    axes: Axes, view: GeoMapInput, area: Bounds, page: Page, inches: tuple[float, float]
) -> None:
    dress(axes, page.theme)
    axes.set_xlim(area.x0, area.x1)
    axes.set_ylim((area.y1, area.y0) if view.y_down else (area.y0, area.y1))
    axes.set_xticks(ticks(area.x0, area.x1, max(2, int(inches[0] / 0.7))))
    axes.set_yticks(ticks(area.y0, area.y1, max(2, int(inches[1] / 0.7))))
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    for spine in axes.spines.values():
        spine.set_visible(True)


def _side(
    figure: Figure, page: Page, view: GeoMapInput, model: GeoMapModel, corner: tuple[float, float]
) -> None:
    """Colour bars and legend, one under the other from `corner` (inches) downwards."""
    left, top = corner
    high = min(2.0, (top - 0.6) * 0.33)
    gap = 0.32
    if view.mode == "colour":
        label = f"{view.value_label} ({view.value_unit})" if view.value_unit else view.value_label
        box = page.box(left, top - gap - high, 0.16, high)
        colour_scale(figure, page, box, model.value_range, label, turbo)
        top -= high + gap + 0.25
    if model.heat_range is not None:
        label = f"{view.heat_label} ({view.heat_unit})" if view.heat_unit else view.heat_label
        box = page.box(left, top - gap - high, 0.16, high)
        colour_scale(figure, page, box, model.heat_range, label, turbo)
        top -= high + gap + 0.25
    _legend(figure, page, view, model, left, top)


def _legend(
    figure: Figure, page: Page, view: GeoMapInput, model: GeoMapModel, left: float, top: float
) -> None:
    from matplotlib.lines import Line2D

    theme = page.theme
    marks: list[tuple[str, str, tuple[int, int, int], bool]] = []
    if view.mode == "full":
        marks = [
            ("sim prediction", "D", theme.sim, True),
            ("real prediction", "D", theme.real, False),
            ("ground truth", "o", theme.truth, True),
        ]
    if model.grey.any():
        marks.append(("not selected", ".", theme.unselected, True))
    if model.cursor is not None:
        marks.append((f"instance {model.cursor}", "o", theme.cursor, False))
    if not marks:
        return
    handles = [
        Line2D(
            [],
            [],
            linestyle="none",
            marker=marker,
            markersize=6,
            color=unit(ink),
            markerfacecolor=unit(ink) if filled else "none",
            label=name,
        )
        for name, marker, ink, filled in marks
    ]
    legend = figure.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=((left - 0.12) / page.inches[0], (top - 0.05) / page.inches[1]),
        frameon=False,
        fontsize=9,
        handletextpad=0.3,
        borderaxespad=0,
    )
    for text in legend.get_texts():
        text.set_color(unit(theme.text))
