"""Two runs on paper: each one's errors on a map, on one scale, and beside them the difference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from s2rstore.records import Bounds
from s2rtui.canvas.colour import LIGHT, Rgb, Theme, turbo
from s2rtui.charts.compare.model import difference_model
from s2rtui.charts.compare.paper_difference import difference_legend, draw_difference
from s2rtui.charts.map.paper_points import draw_cursor, draw_others, draw_values
from s2rtui.charts.shared.axis_scale import short
from s2rtui.charts.shared.inputs import DifferenceInput, GeoMapInput, Ground
from s2rtui.charts.shared.map_model import default_view, geomap_model
from s2rtui.charts.shared.paper import (
    Box,
    Page,
    Pixels,
    colour_scale,
    heading,
    new_figure,
    page_of,
    unit,
    written,
)
from s2rtui.charts.shared.paper_map import SIDE, MapSheet, map_panel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Maps = tuple[GeoMapInput, GeoMapInput]
LEFT, FOOT, TITLE, GAP, BESIDE = 0.75, 0.6, 0.34, 0.3, 0.3
"""Inches at the left, at the foot, above each map, between maps, and before the legends."""
KEYS = 1.3
"""Inches that the keys below the scales take."""


@dataclass(frozen=True, slots=True)
class _Plan:
    """The three maps' rectangles and the legends' upper left corner, in inches.

    `row`: all three side by side; else two above the difference, with the scales beside it.
    """

    boxes: tuple[Box, Box, Box]
    corner: tuple[float, float]
    row: bool


def compare_figure(
    maps: Maps,
    difference: DifferenceInput,
    size: Pixels = (2100, 900),
    theme: Theme = LIGHT,
    title: str = "",
    subtitle: str = "",
    notes: tuple[str, ...] = (),
    viewport: Bounds | None = None,
) -> bytes:
    """A PNG of `size` pixels; both `maps` have one value range, `notes` stand under the title."""
    page = page_of(size, theme)
    figure = new_figure(page)
    first, second = difference.names
    title = title or f"{difference.side.capitalize()} error: {first} against {second}"
    top = heading(figure, page, title, "  ·  ".join(part for part in (subtitle, *notes) if part))
    area = viewport or default_view(difference.bounds, difference.truth, difference.valid)
    plan = _plan(page, area, top)
    inks = (theme.text, theme.text, theme.text)
    for view, name, box, ink in zip(maps, difference.names, plan.boxes, inks, strict=False):
        told = name + _median(view) if box[2] > 1.8 else name
        sheet = _panel(figure, page, view.ground, area, box, told, ink)
        model = geomap_model(view)
        draw_others(sheet.axes, view.truth, model.chosen, sheet.spots)
        draw_values(sheet.axes, view, model, sheet.spots)
        draw_cursor(sheet.axes, view, model, theme, area)
    found = difference_model(difference)
    told = f"{first} − {second}"
    sheet = _panel(figure, page, difference.ground, area, plan.boxes[2], told, theme.text)
    draw_difference(sheet, difference, found)
    if page.inches[0] > 4.5:
        left, upper = plan.corner
        bars = (1 if not plan.row else 2, 0.52 if not plan.row else 1.04)
        high = min(1.3, max(0.3, (upper - bars[1] - KEYS - 0.25) / bars[0]))
        below = _error_scale(figure, page, maps[0], plan.corner, high)
        corner = (left, below) if plan.row else (left + 1.2, upper)
        difference_legend(sheet, difference, found, corner, high, left)
    return written(figure, page)


def _plan(page: Page, area: Bounds, top: float) -> _Plan:
    """Whichever arrangement gives the larger maps."""
    wide, _ = page.inches
    side = SIDE + BESIDE if wide > 4.5 else 0.0
    in_row = _scale(area, (wide - LEFT - 0.15 - side - 2 * GAP, top - TITLE - FOOT), (3, 1))
    in_two = _scale(area, (wide - LEFT - 0.15 - GAP, top - 2 * (TITLE + FOOT)), (2, 2))
    row, scale = in_row >= in_two, max(in_row, in_two)
    width, height = area.width * scale, area.height * scale
    first = top - TITLE - height
    places = [(LEFT + index * (width + GAP), first) for index in range(2)]
    if row:
        places.append((LEFT + 2 * (width + GAP), first))
        corner = (LEFT + 3 * width + 2 * GAP + BESIDE, top - TITLE)
    else:
        second = first - FOOT - TITLE - height
        places.append((LEFT, second))
        corner = (LEFT + width + BESIDE, second + height)
    one, two, three = ((x, y, width, height) for x, y in places)
    return _Plan((one, two, three), corner, row)


def _scale(area: Bounds, room: tuple[float, float], count: tuple[int, int]) -> float:
    """Inches per metre where so many maps share so many inches, across and down."""
    across, down = (max(length, 0.3) / n for length, n in zip(room, count, strict=True))
    return min(across / area.width, down / area.height)


def _panel(
    figure: Figure, page: Page, ground: Ground, area: Bounds, box: Box, title: str, ink: Rgb
) -> MapSheet:
    sheet = map_panel(figure, page, ground, area, box)
    if box[0] > LEFT:
        sheet.axes.set_ylabel("")
        sheet.axes.tick_params(labelleft=False)
    label = sheet.axes.set_title(title, loc="left", fontsize=10, pad=6)
    label.set_color(unit(ink))
    label.set_fontweight("bold")
    return sheet


def _median(view: GeoMapInput) -> str:
    """`   median 3.1 m`: of the selected."""
    errors = np.asarray(view.values)[np.asarray(view.selected) & np.asarray(view.valid)]
    errors = errors[np.isfinite(errors)]
    return f"   median {short(float(np.median(errors)))} {view.value_unit}" if errors.size else ""


def _error_scale(
    figure: Figure, page: Page, view: GeoMapInput, corner: tuple[float, float], high: float
) -> float:
    """The scale of both error maps; gives its lower end."""
    left, top = corner
    span = geomap_model(view).value_range
    box = page.box(left, top - 0.52 - high, 0.16, high)
    colour_scale(figure, page, box, span, f"error ({view.value_unit})", turbo)
    return top - 0.52 - high
