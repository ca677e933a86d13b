"""The comparison on paper: a map of each run's errors, and a map of the difference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from s2rstore.records import Bounds
from s2rtui.canvas import LIGHT, Theme
from s2rtui.canvas.fit_text import fit_text
from s2rtui.charts.compare.change import ALL, HEADINGS, signed, table_rows
from s2rtui.charts.compare.model import (
    CompareInput,
    CompareModel,
    change_signs,
    compare_model,
    difference_colours,
    sorted_by_difference,
)
from s2rtui.charts.shared.base_map_background import MapBackground
from s2rtui.charts.shared.base_map_model import MapInput, default_view, map_model
from s2rtui.charts.shared.base_map_paper import (
    MANY,
    SIDE,
    LegendMark,
    MapSheet,
    draw_pose,
    draw_trained,
    draw_unselected,
    draw_values,
    map_panel,
    marker_legend,
)
from s2rtui.drawing.page import (
    NARROW,
    Box,
    Page,
    Pixels,
    draw_colour_bar,
    draw_ring,
    new_page,
    own_settings,
    set_panel_title,
    value_colours,
)
from s2rtui.drawing.scale import short_number

LEFT, FOOT, TITLE, GAP, BESIDE = 0.75, 0.6, 0.34, 0.3, 0.3
"""Inches at the left, at the foot, above each map, between maps, and before the legends."""
ROW = 0.19
"""Height of a row of the table, inches."""
COLUMNS = (1.5, 0.5, 0.7, 0.7, 0.8, 1.4, 0.9)
"""Widths of the columns of the table, inches."""
WIDEST = 22
"""Most letters of a room's name in the table."""
LEGENDS = 3.1
"""Height of scales and legend below the maps of a narrow page, inches."""
KEYS = 1.3
"""Height of the legend below the scales, inches."""
MARKERS = {1: "^", 0: "o", -1: "v"}
"""Markers of changes above, around and below 0: the first run is better, neither, the second."""


@dataclass(frozen=True, slots=True)
class _Plan:
    """Rectangles of the three maps and the upper left corner of the legends, in inches.

    row: all maps side by side, else the difference below the other two.
    """

    boxes: tuple[Box, Box, Box]
    corner: tuple[float, float]
    row: bool


@own_settings()
def compare_figure(
    maps: tuple[MapInput, MapInput],
    difference: CompareInput,
    size: Pixels,
    theme: Theme = LIGHT,
    subtitle: str = "",
    notes: tuple[str, ...] = (),
    viewport: Bounds | None = None,
) -> bytes:
    """Draw the figure in `size` pixels; `maps` share a value range, `notes` follow the title."""
    first, second = difference.names
    title = f"{difference.side.capitalize()} error: {first} against {second}"
    texts = (difference.sentences, subtitle, *notes)
    page = new_page(size, theme, title, "  ·  ".join(part for part in texts if part))
    area = viewport or default_view(difference.bounds, difference.truth, difference.valid)
    table = _table_rows(page, difference)
    is_below = page.inches[0] <= NARROW and page.is_paper
    plan = _plan(page, area, ROW * len(table) + LEGENDS * is_below)
    for data, name, box in zip(maps, difference.names, plan.boxes, strict=False):
        sheet = _panel(page, data.ground, area, box, name + _median(data) * (box[2] > 1.8))
        model = map_model(data)
        draw_unselected(sheet, data.truth, model.selection)
        draw_values(sheet, data, model)
        draw_trained(sheet, data, model)
        if model.cursor is not None:
            draw_pose(sheet, data.truth, data.headings, model.cursor, page.inks.cursor)
    compared = compare_model(difference)
    sheet = _panel(page, difference.ground, area, plan.boxes[2], f"{second} − {first}")
    draw_difference(sheet, difference, compared)
    _draw_table(page, table)
    if page.inches[0] > NARROW or is_below:
        left, top = plan.corner
        if is_below:
            left, top = 0.35, plan.boxes[2][1] - FOOT
        bars, below = (2, 1.04) if plan.row and not is_below else (1, 0.52)
        high = min(1.3, max(0.3, (top - below - KEYS - 0.25) / bars))
        bottom = top - 0.52 - high
        span, label = map_model(maps[0]).value_range, f"error ({maps[0].value_unit})"
        draw_colour_bar(page, left, bottom, high, span, label, value_colours)
        corner = (left, bottom) if plan.row and not is_below else (left + 1.2, top)
        _legend(page, difference, compared, corner, high, left)
    return page.encoded()


def _table_rows(page: Page, data: CompareInput) -> list[tuple[str, ...]]:
    """The table of rooms, as many as the lower third of a wide page can hold; empty elsewhere."""
    changes = data.changes
    most = int(page.inches[1] / 3 / ROW) - 2
    if page.inches[0] < sum(COLUMNS) + LEFT or most < 2 or len(changes.rooms) < 2:
        return []
    rooms = changes.by_size
    rows = [HEADINGS, *table_rows(rooms[:most], changes.whole)]
    if len(rooms) > most:
        rows.append((f"{len(rooms) - most} more rooms",))
    return rows


def _draw_table(page: Page, table: list[tuple[str, ...]]) -> None:
    """Draw the table along the lower edge of the page, numbers at their column's right end."""
    inks = page.inks
    for index, cells in enumerate(table):
        y = 0.12 + ROW * (len(table) - 1 - index)
        x = LEFT
        for place, (text, width) in enumerate(zip(cells, COLUMNS, strict=False)):
            ink = inks.muted if index == 0 else inks.text
            weight = "bold" if cells[0] == ALL else "normal"
            x += width
            at, align = (x - width, "left") if place == 0 else (x, "right")
            text = text if place else fit_text(text, WIDEST, "…")
            page.text(at, y, text, ink, 8.5, ha=align, fontweight=weight)


def _plan(page: Page, area: Bounds, below: float) -> _Plan:
    """The arrangement that gives the larger maps, `below` inches left free at the foot."""
    (wide, _), top = page.inches, page.top
    side = SIDE + BESIDE if wide > NARROW else 0.0
    in_row = _scale(area, (wide - LEFT - 0.15 - side - 2 * GAP, top - TITLE - FOOT - below), (3, 1))
    in_two = _scale(area, (wide - LEFT - 0.15 - GAP, top - 2 * (TITLE + FOOT) - below), (2, 2))
    row = in_row >= in_two and not (page.is_paper and wide <= NARROW)
    scale = in_row if row else in_two
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


def _panel(page: Page, ground: MapBackground, area: Bounds, box: Box, title: str) -> MapSheet:
    sheet = map_panel(page, ground, area, box)
    if box[0] > LEFT:
        sheet.axes.set_ylabel("")
        sheet.axes.tick_params(labelleft=False)
    set_panel_title(sheet.axes, title, page.inks.text)
    return sheet


def _median(data: MapInput) -> str:
    """The median error of the selected, as `   median 3.1 m`."""
    errors = np.asarray(data.values)[np.asarray(data.selected) & np.asarray(data.valid)]
    errors = errors[np.isfinite(errors)]
    if not errors.size:
        return ""
    return f"   median {short_number(float(np.median(errors)))} {data.value_unit}"


def draw_difference(sheet: MapSheet, data: CompareInput, model: CompareModel) -> None:
    """Draw unselected points, differences and the cursor.

    Triangles point down where the second run is better, up where the first is; dots are equal.
    """
    draw_unselected(sheet, data.truth, model.selection)
    ids, apart = sorted_by_difference(data, model)
    held = sheet.last_per_spot(data.truth, ids)
    truth, apart = np.asarray(data.truth, dtype=np.float64)[ids[held]], apart[held]
    which = change_signs(apart, data.equal)
    colours = difference_colours(apart, model.scale) / 255.0
    size, width = (34, 0.6) if len(held) <= MANY else (5, 0)
    edge = [sheet.page.inks.background]
    for order, verdict in enumerate((0, -1, 1)):
        part = which == verdict
        x, y = truth[part].T
        sheet.axes.scatter(
            x, y, s=size, marker=MARKERS[verdict], c=colours[part], edgecolors=edge,
            linewidths=width, zorder=5 + order / 10,
        )  # fmt: skip
    if model.cursor is not None:
        x, y = data.truth[model.cursor]
        draw_ring(sheet.axes, x, y, sheet.page.inks.cursor, 80, 7)


def _legend(
    page: Page,
    data: CompareInput,
    model: CompareModel,
    corner: tuple[float, float],
    high: float,
    keys: float,
) -> None:
    """Draw the scale, how often each run is better, and the median change.

    high: height of the scale in inches. keys: left end of the markers.
    """
    left, top = corner
    label = f"{data.names[1]} −\n{data.names[0]} ({data.unit})"
    draw_colour_bar(
        page, left, top - 0.52 - high, high, (-model.scale, model.scale), label,
        lambda shares: difference_colours(2 * shares - 1, 1.0),
    )  # fmt: skip
    summary, inks = model.summary, page.inks
    ends = difference_colours([-1.0, 0.0, 1.0], 1.0) / 255
    blue, grey, orange = ((r, g, b) for r, g, b in ends.tolist())
    marks: list[LegendMark] = [
        (f"{summary.improved} better in {data.names[1]}", "v", blue, True),
        (f"{summary.worse} better in {data.names[0]}", "^", orange, True),
        (f"{summary.equal} within {short_number(data.equal)} {data.unit}", "o", grey, True),
    ]
    if (whole := data.changes.whole).n:
        text = f"median {signed(whole.change.value)} {data.unit}"
        marks.append((text, "", inks.text, False))
    if model.others:
        marks.append(("not selected", ".", inks.unselected, True))
    if model.cursor is not None:
        marks.append((f"instance {model.cursor}", "o", inks.cursor, False))
    marker_legend(page, marks, (keys, top - 0.52 - high - 0.25))
