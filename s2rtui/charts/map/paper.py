"""The map on paper: values, predictions or error wedges on the floor plan."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds
from s2rtui.canvas import LIGHT, Theme
from s2rtui.charts.map.model import (
    LARGEST,
    ErrorGlyphs,
    arc_degrees,
    arc_turns,
    error_glyphs,
    full_scale,
    iids_with_error_lines,
)
from s2rtui.charts.shared.base_map_model import MapInput, MapModel, default_view, map_model
from s2rtui.charts.shared.base_map_paper import (
    MANY,
    LegendMark,
    MapSheet,
    draw_pose,
    draw_trained,
    draw_unselected,
    draw_values,
    map_sheet,
    marker_legend,
)
from s2rtui.drawing.heat_colours import heat_ramp
from s2rtui.drawing.page import (
    NARROW,
    Inks,
    Page,
    Pixels,
    draw_colour_bar,
    label_with_unit,
    new_page,
    own_settings,
    value_colours,
    wrapped_label,
)
from s2rtui.drawing.scale import short_number

LINES_UP_TO = 200
"""Up to this number of selected instances, error lines are drawn."""
CELL, FOOTPRINT = 6.0, (4, 2)
"""Width of a cell in points, and the cells by which wedges keep their distance."""
BAR = 0.9
"""Height of a colour bar under the map, inches."""
ARROW = 0.03
"""Length of the arrow of a planned pose over the longer side of the map."""
RADIUS, THICK = 11.0, 4.5
"""Points."""
Span = tuple[float, float]


@own_settings()
def map_figure(
    data: MapInput,
    size: Pixels,
    theme: Theme = LIGHT,
    title: str = "",
    subtitle: str = "",
    viewport: Bounds | None = None,
) -> bytes:
    """Draw the figure in `size` pixels."""
    page = new_page(size, theme, title, subtitle)
    model = map_model(data)
    area = viewport or default_view(data.bounds, data.truth, data.valid)
    below = _height_below(page, data, model)
    sheet = map_sheet(data.ground, area, page, below)
    draw_unselected(sheet, data.truth, model.selection)
    DRAWINGS[data.mode](sheet, data, model)
    draw_trained(sheet, data, model)
    _draw_planned(sheet, data)
    if (cursor := model.cursor) is not None:
        draw_pose(sheet, data.truth, data.headings, cursor, page.inks.cursor)
        if data.mode == "full":
            _draw_error_lines(sheet, data, np.array([cursor]))
            draw_pose(sheet, data.sim, data.sim_headings, cursor, page.inks.sim)
            draw_pose(sheet, data.real, data.real_headings, cursor, page.inks.real)
    if sheet.side:
        _draw_side(sheet, data, model, sheet.side)
    return page.encoded()


def _draw_side(
    sheet: MapSheet, data: MapInput, model: MapModel, corner: tuple[float, float]
) -> None:
    """Draw colour bars and legend from `corner` (inches) downwards."""
    (left, top), page = corner, sheet.page
    is_below = page.inches[0] <= NARROW
    letters = 16 if is_below else 23
    high = BAR if is_below else min(2.0, (top - 0.6) * 0.33)
    lowest = top
    if data.mode == "colour" and data.value_label:
        label = wrapped_label(label_with_unit(data.value_label, data.value_unit), letters)
        foot = top - 0.32 - 0.17 * label.count("\n") - high
        scale = model.value_range, label, value_colours, data.value_range is None
        draw_colour_bar(page, left, foot, high, *scale)
        lowest = foot - 0.25
        if is_below:
            left += 1.45
        else:
            top = lowest
    if model.heat_range is not None:
        label = wrapped_label(label_with_unit(data.heat_label, data.heat_unit), letters)
        foot = top - 0.32 - 0.17 * label.count("\n") - high
        ramp = heat_ramp(data.heat_is_signed, value_colours)
        draw_colour_bar(page, left, foot, high, model.heat_range, label, ramp)
        lowest = min(lowest, foot - 0.25)
    marker_legend(page, _marks(data, model, page.inks), (corner[0], lowest))


def _height_below(page: Page, data: MapInput, model: MapModel) -> float:
    """Inches of the legends under the map of a narrow page; 0 where there is no room for them."""
    if not page.is_paper:
        return 0.0
    bars = data.mode == "colour" or model.heat_range is not None
    marks = sum(1 + len(name) // 24 for name, *_ in _marks(data, model, page.inks))
    return bars * (BAR + 0.9) + 0.2 * marks + 0.1


def _marks(data: MapInput, model: MapModel, inks: Inks) -> list[LegendMark]:
    marks: list[LegendMark] = []
    if data.mode == "full":
        marks = [
            ("sim prediction", "D", inks.sim, True),
            ("real prediction", "D", inks.real, False),
            ("ground truth", "o", inks.truth, True),
        ]
    elif data.mode == "glyph":
        full = f"{LARGEST:g}° wide = {short_number(full_scale(data), 2)} m"
        marks = [
            ("sim error", "s", inks.sim, True),
            ("real error", "s", inks.real, True),
            ("both", "s", inks.both, True),
            (full, "", inks.text, False),
            ("ground truth", "o", inks.truth, True),
        ]
        if model.highlighted > 1:
            marks.append(("number: mean of n", "", inks.text, False))
    if data.trained is not None:
        marks.append(("trained on", "o", inks.text, False))
    if model.others:
        marks.append(("not selected", ".", inks.unselected, True))
    if data.planned:
        marks.append((f"{len(data.planned)} planned poses", ">", inks.planned, True))
    if model.cursor is not None:
        marks.append((f"instance {model.cursor}", "o", inks.cursor, False))
    if data.clip is not None:
        marks.append(("dimmed: not seen by the selection", "s", inks.faint, False))
    return marks


def _draw_planned(sheet: MapSheet, data: MapInput) -> None:
    """Draw an arrow from each planned pose in the direction of its heading."""
    if not data.planned:
        return
    poses = np.array([(pose.x_m, pose.y_m, pose.heading_deg) for pose in data.planned])
    inks, length = sheet.page.inks, ARROW * max(sheet.area.width, sheet.area.height)
    turn = np.radians(poses[:, 2])
    sheet.axes.quiver(
        poses[:, 0], poses[:, 1], length * np.cos(turn), length * np.sin(turn), angles="xy",
        scale_units="xy", scale=1, width=0.0035, headwidth=4.5, headlength=4.5, headaxislength=4,
        color=inks.planned, edgecolor=inks.background, linewidth=0.5, zorder=7,
    )  # fmt: skip


def draw_predictions(sheet: MapSheet, data: MapInput, model: MapModel) -> None:
    """Draw predictions and truth of the selected, joined by lines where they are few."""
    ids, inks = model.selection.members, sheet.page.inks
    _draw_error_lines(sheet, data, iids_with_error_lines(data, model, limit=LINES_UP_TO))
    shrink, edge = 0.2 if len(ids) > MANY else 1.0, inks.background
    for points, marker, size, width, face, line, order in (
        (data.sim, "D", 20, 0.0, inks.sim, inks.sim, 5),
        (data.real, "D", 20, 1.1, edge, inks.real, 5),
        (data.truth, "o", 22, 0.6, inks.truth, edge, 6),
    ):
        x, y = sheet.thinned(points, ids).T
        sheet.axes.scatter(
            x, y, s=size * shrink, marker=marker, facecolors=[face], edgecolors=[line],
            linewidths=width * shrink, zorder=order,
        )  # fmt: skip


def _draw_error_lines(sheet: MapSheet, data: MapInput, ids: NDArray[np.intp]) -> None:
    from matplotlib.collections import LineCollection

    alpha = 0.55 if len(ids) <= 40 else 0.3
    for start, end, ink in (
        (data.true_positions("sim"), data.sim, sheet.page.inks.sim),
        (data.true_positions("real"), data.real, sheet.page.inks.real),
    ):
        ends = [np.asarray(points, dtype=np.float64)[ids] for points in (start, end)]
        lines = np.stack(ends, axis=1)
        known = list(lines[np.isfinite(lines).all(axis=(1, 2))])
        collection = LineCollection(known, colors=[ink], linewidths=0.7, alpha=alpha, zorder=4)
        sheet.axes.add_collection(collection)


def draw_wedges(sheet: MapSheet, data: MapInput, model: MapModel) -> None:
    """Draw errors as wedges of sim and real; their overlap has a third colour."""
    from matplotlib.patches import Wedge

    inks, axes = sheet.page.inks, sheet.axes
    x, y = sheet.thinned(data.truth, model.selection.members).T
    frame = sheet.grid(CELL)
    glyph_set = error_glyphs(data, model, frame, FOOTPRINT)
    size, alpha = (1, 0.25) if glyph_set.crowded else (4, 1.0)
    axes.scatter(x, y, s=size, color=inks.truth, alpha=alpha, linewidths=0, zorder=4)
    metres = sheet.area.width / sheet.inches[0] / 72
    centres = glyph_set.centres * (frame.pitch, 2 * frame.pitch * (1 if data.y_down else -1))
    centres += (frame.x0, frame.y0)
    sim, real = (_spans(glyph_set, part) for part in (glyph_set.sim, glyph_set.real))
    for (x, y), count, first, second in zip(
        centres.tolist(), glyph_set.counts.tolist(), sim, real, strict=True
    ):
        for span, ink, order in (
            (first, inks.sim, 5.0),
            (second, inks.real, 5.1),
            (_overlap(first, second), inks.both, 5.2),
        ):
            if span is not None:
                wedge = Wedge(
                    (x, y), RADIUS * metres, *span, width=THICK * metres, facecolor=ink,
                    edgecolor=inks.background, linewidth=0.5, zorder=order,
                )  # fmt: skip
                axes.add_patch(wedge)
        _draw_middle(sheet, (x, y), count)


def _draw_middle(sheet: MapSheet, centre: tuple[float, float], count: int) -> None:
    """A dot for one instance, else the number of combined ones."""
    page = sheet.page
    if count == 1:
        x, y = centre
        sheet.axes.scatter([x], [y], s=12, color=page.inks.truth, linewidths=0, zorder=6)
        return
    text = str(count) if count < 1000 else f"{count // 1000}k"
    ink = page.inks.truth if page.theme.dark else page.inks.text
    sheet.axes.annotate(
        text, centre, ha="center", va="center", fontsize=6, fontweight="bold", color=ink, zorder=6,
        annotation_clip=True, path_effects=page.halo(2),
    )  # fmt: skip


def _spans(glyph_set: ErrorGlyphs, vectors: NDArray[np.float64]) -> list[Span | None]:
    """First and last angle of each wedge in degrees of the map; None where unknown."""
    middles = np.degrees(arc_turns(vectors, True))
    halves = np.asarray(arc_degrees(vectors, glyph_set.full)) / 2
    return [
        None if math.isnan(middle) else (middle - half, middle + half)
        for middle, half in zip(middles.tolist(), halves.tolist(), strict=True)
    ]


def _overlap(first: Span | None, second: Span | None) -> Span | None:
    """The overlap of two spans of at most 180 degrees."""
    if first is None or second is None:
        return None
    turn = 360 * round((sum(first) - sum(second)) / 720)
    low, high = max(first[0], second[0] + turn), min(first[1], second[1] + turn)
    return (low, high) if high > low else None


DRAWINGS = {"colour": draw_values, "glyph": draw_wedges, "full": draw_predictions}
"""How the selected are drawn, per map mode."""
