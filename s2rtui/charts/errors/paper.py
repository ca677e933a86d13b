"""The errors on paper: histograms of sim and real on one axis, with medians."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from s2rtui.canvas import LIGHT, Theme
from s2rtui.charts.errors.model import NAMES, ErrorsInput, ErrorsModel, SideErrors, errors_model
from s2rtui.charts.shared.axis_scale import short_number
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

BINS = 60


def errors_figure(
    data: ErrorsInput,
    size: Pixels = (1600, 900),
    theme: Theme = LIGHT,
    title: str = "Errors in simulation and in reality",
    subtitle: str = "",
) -> bytes:
    """Draw the figure in `size` pixels; each side has its own scale of counts."""
    page = make_page(size, theme)
    model = errors_model(data, BINS)
    figure = new_figure(page)
    top = draw_heading(figure, page, title, subtitle)
    wide, _ = page.inches
    height = max(0.2, (top - 0.6 - 0.75) / 2)
    for index, (name, errors) in enumerate(zip(NAMES, (model.sim, model.real), strict=True)):
        bottom = 0.6 + (1 - index) * (height + 0.45)
        axes = figure.add_axes(page.box(0.75, bottom, wide - 1.0, height))
        _side(axes, model, errors, name, data, page)
        if index:
            axes.set_xlabel(_axis_name(data, model))
        else:
            axes.tick_params(labelbottom=False)
    return figure_bytes(figure, page)


def _axis_name(data: ErrorsInput, model: ErrorsModel) -> str:
    name = f"{data.label} ({data.unit})" if data.unit else data.label
    if model.sim.beyond + model.real.beyond:
        name += f", last bar: {short_number(model.upper)} and more"
    return name


def _side(
    axes: Axes, model: ErrorsModel, errors: SideErrors, name: str, data: ErrorsInput, page: Page
) -> None:
    from matplotlib.ticker import MaxNLocator

    theme = page.theme
    ink = theme.sim if name == "sim" else theme.real
    style_axes(axes, theme)
    width = model.upper / len(errors.highlighted)
    left = np.asarray(model.edges[:-1]) + width / 2
    axes.bar(left, errors.total, width=width * 0.92, color=rgb_fractions(theme.faint), linewidth=0)
    axes.bar(
        left,
        errors.highlighted,
        width=width * 0.92,
        color=rgb_fractions(ink),
        linewidth=0,
        zorder=3,
    )
    axes.set_xlim(0, model.upper)
    axes.set_ylim(0, errors.peak * 1.08)
    axes.set_ylabel("instances")
    axes.yaxis.set_label_coords(-0.48 / (page.inches[0] - 1.0), 0.5)
    axes.yaxis.set_major_locator(MaxNLocator(nbins=4, integer=True))
    title = f"{name}   {int(errors.highlighted.sum())} of {int(errors.total.sum())}"
    label = axes.set_title(title, loc="left", fontsize=10, pad=6)
    label.set_color(rgb_fractions(ink))
    label.set_fontweight("bold")
    if math.isfinite(errors.median):
        at = min(errors.median, model.upper)
        axes.axvline(
            at, color=rgb_fractions(theme.text), linewidth=1.2, linestyle=(0, (3, 2)), zorder=4
        )
        text = f"median {short_number(errors.median)} {data.unit}".rstrip()
        note = axes.set_title(text, loc="right", fontsize=9, pad=6)
        note.set_color(rgb_fractions(theme.text))
    if errors.cursor is not None:
        at = min(errors.cursor, model.upper)
        axes.plot([at], [0], marker="^", markersize=8, color=rgb_fractions(theme.cursor), zorder=5)
        axes.lines[-1].set_clip_on(False)
