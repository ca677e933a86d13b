"""Draw the lines between the rows of a table on axes of matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from s2rtui.drawing.page import Ink, Page
from s2rtui.drawing.row_lines import LineLayer, RowLines
from s2rtui.drawing.scale import Scale

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BINS = 500
"""Bins of a scale for bands."""
_BANDS = ((0, 4, 0.16), (1, 3, 0.26))
"""The quantiles at the ends of each band, and its opacity."""


def draw_row_lines(axes: Axes, page: Page, lines: RowLines, scale: Scale) -> None:
    """Draw the lines of all rows, row k at y = k, that of the cursor on top."""
    for order, layer in enumerate(lines.layers):
        ink: Ink = getattr(page.inks, layer.ink)
        if layer.is_pale:
            red, green, blue = np.mean([ink, page.inks.background], axis=0).tolist()
            ink = red, green, blue
        draw = _draw_bands if layer.is_banded else _draw_lines
        draw(axes, layer, scale, ink, 3.5 if layer.ink == "cursor" else 1 + 0.2 * order)


def _draw_bands(axes: Axes, layer: LineLayer, scale: Scale, ink: Ink, order: float) -> None:
    places = scale.value(layer.quantiles(scale, _BINS))
    rows = np.arange(len(places))
    for left, right, opacity in _BANDS:
        axes.fill_betweenx(rows, places[:, left], places[:, right], color=ink, alpha=opacity,
                           linewidth=0, zorder=order)  # fmt: skip
    axes.plot(places[:, 2], rows, color=ink, linewidth=1.1, alpha=0.8, zorder=order + 0.1)


def _draw_lines(axes: Axes, layer: LineLayer, scale: Scale, ink: Ink, order: float) -> None:
    """A line per instance, interrupted where it has no value."""
    places = scale.value(layer.shares(scale))
    is_cursor = layer.ink == "cursor"
    opacity = 1.0 if is_cursor else 0.45 if layer.ink == "unselected" else 0.75
    axes.plot(places, np.arange(len(places)), color=ink, linewidth=1.4 if is_cursor else 0.7,
              alpha=opacity, zorder=order)  # fmt: skip
