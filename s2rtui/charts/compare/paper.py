"""The comparison on paper: a map of each run's errors, and a map of the difference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from s2rstore.records import Bounds
from s2rtui.canvas import LIGHT, Rgb, Theme, turbo
from s2rtui.charts.compare.model import (
    CompareInput,
    CompareModel,
    better_run,
    compare_model,
    difference_colours,
    sorted_by_difference,
)
from s2rtui.charts.shared.axis_scale import short_number
from s2rtui.charts.shared.base_map_background import MapBackground
from s2rtui.charts.shared.base_map_model import MapInput, default_view, map_model
from s2rtui.charts.shared.base_map_paper import (
    MANY,
    SIDE,
    MapSheet,
    draw_pose,
    draw_unselected,
    draw_values,
    map_panel,
    marker_legend,
)
from s2rtui.charts.shared.paper import (
    Box,
    Page,
    Pixels,
    draw_colour_bar,
    draw_heading,
    figure_bytes,
    make_page,
    new_figure,
    rgb_fractions,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Maps = tuple[MapInput, MapInput]
LEFT, FOOT, TITLE, GAP, BESIDE = 0.75, 0.6, 0.34, 0.3, 0.3
"""Inches at the left, at the foot, above each map, between maps, and before the legends."""
KEYS = 1.3
"""Height of the legend below the scales, inches."""


@dataclass(frozen=True, slots=True)
class _Plan:
    """Rectangles of the three maps and the upper left corner of the legends, in inches.

    row: all maps side by side, else the difference below the other two.
    """

    boxes: tuple[Box, Box, Box]
    corner: tuple[float, float]
    row: bool


def compare_figure(
    maps: Maps,
    difference: CompareInput,
    size: Pixels = (2100, 900),
    theme: Theme = LIGHT,
    title: str = "",
    subtitle: str = "",
    notes: tuple[str, ...] = (),
    viewport: Bounds | None = None,
) -> bytes:
    """Draw the figure in `size` pixels; `maps` share a value range, `notes` follow the title."""
    page = make_page(size, theme)
    figure = new_figure(page)
    first, second = difference.names
    title = title or f"{difference.side.capitalize()} error: {first} against {second}"
    top = draw_heading(
        figure, page, title, "  ·  ".join(part for part in (subtitle, *notes) if part)
    )
    area = viewport or default_view(difference.bounds, difference.truth, difference.valid)
    plan = _plan(page, area, top)
    inks = (theme.text, theme.text, theme.text)
    for data, name, box, ink in zip(maps, difference.names, plan.boxes, inks, strict=False):
        panel_title = name + _median(data) if box[2] > 1.8 else name
        sheet = _panel(figure, page, data.ground, area, box, panel_title, ink)
        model = map_model(data)
        draw_unselected(sheet.axes, data.truth, model.selection, sheet.spots)
        draw_values(sheet.axes, data, model, sheet.spots)
        if model.cursor is not None:
            draw_pose(sheet.axes, data.truth, data.headings, model.cursor, theme.cursor, area)
    compared = compare_model(difference)
    panel_title = f"{first} − {second}"
    sheet = _panel(figure, page, difference.ground, area, plan.boxes[2], panel_title, theme.text)
    draw_difference(sheet, difference, compared)
    if page.inches[0] > 4.5:
        left, upper = plan.corner
        bars = (1 if not plan.row else 2, 0.52 if not plan.row else 1.04)
        high = min(1.3, max(0.3, (upper - bars[1] - KEYS - 0.25) / bars[0]))
        below = _error_scale(figure, page, maps[0], plan.corner, high)
        corner = (left, below) if plan.row else (left + 1.2, upper)
        difference_legend(sheet, difference, compared, corner, high, left)
    return figure_bytes(figure, page)


def _plan(page: Page, area: Bounds, top: float) -> _Plan:
    """The arrangement that gives the larger maps."""
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
    """Inches per metre of `count` maps (across, down) in `room` inches."""
    across, down = (max(length, 0.3) / n for length, n in zip(room, count, strict=True))
    return min(across / area.width, down / area.height)


def _panel(
    figure: Figure, page: Page, ground: MapBackground, area: Bounds, box: Box, title: str, ink: Rgb
) -> MapSheet:
    sheet = map_panel(figure, page, ground, area, box)
    if box[0] > LEFT:
        sheet.axes.set_ylabel("")
        sheet.axes.tick_params(labelleft=False)
    label = sheet.axes.set_title(title, loc="left", fontsize=10, pad=6)
    label.set_color(rgb_fractions(ink))
    label.set_fontweight("bold")
    return sheet


def _median(data: MapInput) -> str:
    """The median error of the selected, as `   median 3.1 m`."""
    errors = np.asarray(data.values)[np.asarray(data.selected) & np.asarray(data.valid)]
    errors = errors[np.isfinite(errors)]
    return (
        f"   median {short_number(float(np.median(errors)))} {data.value_unit}"
        if errors.size
        else ""
    )


def _error_scale(
    figure: Figure, page: Page, data: MapInput, corner: tuple[float, float], high: float
) -> float:
    """Draw the scale of both error maps; returns its lower end in inches."""
    left, top = corner
    span = map_model(data).value_range
    box = page.box(left, top - 0.52 - high, 0.16, high)
    draw_colour_bar(figure, page, box, span, f"error ({data.value_unit})", turbo)
    return top - 0.52 - high


MARKERS = {1: "^", 0: "o", -1: "v"}


def draw_difference(sheet: MapSheet, data: CompareInput, model: CompareModel) -> None:
    """Draw unselected points, differences and the cursor."""
    draw_unselected(sheet.axes, data.truth, model.selection, sheet.spots)
    _signs(sheet, data, model)
    if model.cursor is not None:
        _cursor(sheet.axes, data, model.cursor, sheet.page.theme)


def _signs(sheet: MapSheet, data: CompareInput, model: CompareModel) -> None:
    """Triangles up where the second run is better, down where the first is, else dots."""
    ids, apart = sorted_by_difference(data, model)
    held = sheet.spots.last(data.truth, ids)
    truth, apart = np.asarray(data.truth, dtype=np.float64)[ids[held]], apart[held]
    which = better_run(apart, data.equal)
    ink = difference_colours(apart, model.scale) / 255.0
    few = len(held) <= MANY
    for order, verdict in enumerate((0, -1, 1)):
        part = which == verdict
        sheet.axes.scatter(
            truth[part, 0],
            truth[part, 1],
            s=34 if few else 5,
            marker=MARKERS[verdict],
            c=ink[part],
            edgecolors=[rgb_fractions(sheet.page.theme.background)],
            linewidths=0.6 if few else 0,
            zorder=5 + order / 10,
        )


def _cursor(axes: Axes, data: CompareInput, iid: int, theme: Theme) -> None:
    x, y = (float(part) for part in np.asarray(data.truth)[iid])
    ink = rgb_fractions(theme.cursor)
    axes.scatter([x], [y], s=80, facecolors="none", edgecolors=[ink], linewidths=1.6, zorder=7)


def difference_legend(
    sheet: MapSheet,
    data: CompareInput,
    model: CompareModel,
    corner: tuple[float, float],
    high: float,
    keys: float,
) -> None:
    """Draw the scale, how often each run is better, and the mean difference.

    high: height of the scale in inches. keys: left end of the markers.
    """
    left, top = corner
    box = sheet.page.box(left, top - 0.52 - high, 0.16, high)
    label = f"{data.names[0]} −\n{data.names[1]} ({data.unit})"
    ends = (-model.scale, model.scale)
    draw_colour_bar(
        sheet.figure,
        sheet.page,
        box,
        ends,
        label,
        lambda shares: difference_colours(2 * shares - 1, 1.0),
    )
    theme, summary = sheet.page.theme, model.summary
    blue, grey, orange = (
        (int(r), int(g), int(b)) for r, g, b in difference_colours([-1.0, 0.0, 1.0], 1.0)
    )
    marks: list[tuple[str, str, Rgb, bool]] = [
        (f"{summary.improved} better in {data.names[1]}", "^", orange, True),
        (f"{summary.worse} better in {data.names[0]}", "v", blue, True),
        (f"{summary.equal} within {short_number(data.equal)} {data.unit}", "o", grey, True),
    ]
    if summary.improved + summary.worse + summary.equal:
        marks.append((f"mean {summary.mean:+.2f} {data.unit}", "", theme.text, False))
    if model.others:
        marks.append(("not selected", ".", theme.unselected, True))
    if model.cursor is not None:
        marks.append((f"instance {model.cursor}", "o", theme.cursor, False))
    marker_legend(sheet, marks, (keys, top - 0.52 - high - 0.25))
