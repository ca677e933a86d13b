"""The errors on paper: histograms of sim and real on one axis, with medians."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from s2rtui.canvas import LIGHT, Theme
from s2rtui.charts.errors.model import NAMES, ErrorsInput, ErrorsModel, SideErrors, errors_model
from s2rtui.drawing.page import (
    NARROW,
    Ink,
    Page,
    Pixels,
    label_with_unit,
    new_page,
    own_settings,
    set_panel_title,
    style_axes,
)
from s2rtui.drawing.scale import short_number

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BINS = 60


@own_settings()
def errors_figure(
    data: ErrorsInput, size: Pixels, theme: Theme = LIGHT, title: str = "", subtitle: str = ""
) -> bytes:
    """Draw the figure in `size` pixels; both sides share one scale of counts."""
    page = new_page(size, theme, title, subtitle)
    model = errors_model(data, BINS)
    width, height = page.inches[0] - 1.0, max(0.2, (page.top - 0.6 - 0.75) / 2)
    for index, (name, errors) in enumerate(zip(NAMES, (model.sim, model.real), strict=True)):
        axes = page.axes(0.75, 0.6 + (1 - index) * (height + 0.45), width, height)
        style_axes(axes, page)
        ink = getattr(page.inks, name)
        _draw_bars(axes, model, errors, page, ink)
        counts = f"{int(errors.highlighted.sum())} of {int(errors.total.sum())}"
        set_panel_title(axes, f"{name}   {counts}", ink, 10 if page.inches[0] > NARROW else 8)
        _draw_marks(axes, model, errors, page, data.unit)
        if index:
            axes.set_xlabel(_axis_name(data, model))
        else:
            axes.tick_params(labelbottom=False)
    return page.encoded()


def _axis_name(data: ErrorsInput, model: ErrorsModel) -> str:
    name = label_with_unit(data.label, data.unit)
    if model.sim.beyond + model.real.beyond:
        name += f", last bar: {short_number(model.upper)} and more"
    return name


def _draw_bars(axes: Axes, model: ErrorsModel, errors: SideErrors, page: Page, ink: Ink) -> None:
    from matplotlib.ticker import MaxNLocator

    width = model.upper / len(errors.highlighted)
    middles = model.edges[:-1] + width / 2
    wide = width * 0.92
    axes.bar(middles, errors.total, width=wide, color=page.inks.faint, linewidth=0)
    axes.bar(middles, errors.highlighted, width=wide, color=ink, linewidth=0, zorder=3)
    axes.set_xlim(0, model.upper)
    axes.set_ylim(0, model.peak * 1.08)
    axes.set_ylabel("instances")
    axes.yaxis.set_label_coords(-0.48 / (page.inches[0] - 1.0), 0.5)
    axes.yaxis.set_major_locator(MaxNLocator(nbins=4, integer=True))


def _draw_marks(axes: Axes, model: ErrorsModel, errors: SideErrors, page: Page, unit: str) -> None:
    """The median as a line with its number, and the error of the cursor's instance."""
    inks = page.inks
    if math.isfinite(errors.median):
        at = min(errors.median, model.upper)
        axes.axvline(at, color=inks.text, linewidth=1.2, linestyle=(0, (3, 2)), zorder=4)
        text = f"median {short_number(errors.median)} {unit}".rstrip()
        points = 9 if page.inches[0] > NARROW else 8
        axes.set_title(text, loc="right", fontsize=points, pad=6, color=inks.text)
    if errors.cursor is not None:
        at = min(errors.cursor, model.upper)
        axes.plot([at], [0], marker="^", markersize=8, color=inks.cursor, zorder=5, clip_on=False)
