"""The map on paper: values, predictions or error wedges on the floor plan."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds
from s2rtui.canvas import LIGHT, Rgb, Theme, turbo
from s2rtui.charts.map.model import (
    LARGEST,
    ErrorGlyphs,
    arc_degrees,
    arc_turns,
    error_glyphs,
    full_scale,
    iids_with_error_lines,
)
from s2rtui.charts.shared.axis_scale import short_number
from s2rtui.charts.shared.base_map_model import MapInput, MapModel, default_view, map_model
from s2rtui.charts.shared.base_map_paper import (
    MANY,
    MapSheet,
    Spots,
    draw_pose,
    draw_unselected,
    draw_values,
    map_sheet,
    marker_legend,
)
from s2rtui.charts.shared.paper import (
    Pixels,
    draw_colour_bar,
    figure_bytes,
    make_page,
    rgb_fractions,
    wrapped_label,
)

if TYPE_CHECKING:
    from matplotlib.patheffects import AbstractPathEffect

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WHAT = {"full": "predicted and true positions", "glyph": "direction and size of the errors"}


def map_figure(
    data: MapInput,
    size: Pixels = (1600, 1200),
    theme: Theme = LIGHT,
    run: str = "",
    subtitle: str = "",
    title: str = "",
    viewport: Bounds | None = None,
) -> bytes:
    """Draw the figure in `size` pixels."""
    page = make_page(size, theme)
    model = map_model(data)
    area = viewport or default_view(data.bounds, data.truth, data.valid)
    sheet = map_sheet(data.ground, area, page, title or _title(data, run), subtitle)
    draw_unselected(sheet.axes, data.truth, model.selection, sheet.spots)
    if data.mode == "full":
        draw_predictions(sheet.axes, data, model, sheet.spots)
    elif data.mode == "glyph":
        draw_wedges(sheet, data, model)
    else:
        draw_values(sheet.axes, data, model, sheet.spots)
    if (cursor := model.cursor) is not None:
        draw_pose(sheet.axes, data.truth, data.headings, cursor, theme.cursor, area)
        if data.mode == "full":
            _draw_cursor_predictions(sheet.axes, data, cursor, theme, area)
    if sheet.side:
        _side(sheet, data, model, sheet.side)
    return figure_bytes(sheet.figure, page)


def _title(data: MapInput, run: str) -> str:
    what = WHAT.get(data.mode, data.value_label)
    what = f"{what} and {data.heat_label}" if data.heat is not None else what
    return f"{run}: {what}" if run else what[:1].upper() + what[1:]


def _side(sheet: MapSheet, data: MapInput, model: MapModel, corner: tuple[float, float]) -> None:
    """Draw colour bars and legend from `corner` (inches) downwards."""
    left, top = corner
    page = sheet.page
    high = min(2.0, (top - 0.6) * 0.33)
    gap = 0.32
    line = 0.17
    if data.mode == "colour":
        label = f"{data.value_label} ({data.value_unit})" if data.value_unit else data.value_label
        box = page.box(left, top - gap - high, 0.16, high)
        draw_colour_bar(sheet.figure, page, box, model.value_range, label, turbo)
        top -= high + gap + 0.25
    if model.heat_range is not None:
        label = f"{data.heat_label} ({data.heat_unit})" if data.heat_unit else data.heat_label
        label = wrapped_label(label)
        gap += line * label.count("\n")
        box = page.box(left, top - gap - high, 0.16, high)
        draw_colour_bar(sheet.figure, page, box, model.heat_range, label, turbo)
        top -= high + gap + 0.25
    marker_legend(sheet, _marks(data, model, page.theme), (left, top))


def _marks(data: MapInput, model: MapModel, theme: Theme) -> list[tuple[str, str, Rgb, bool]]:
    marks: list[tuple[str, str, Rgb, bool]] = []
    if data.mode == "full":
        marks = [
            ("sim prediction", "D", theme.sim, True),
            ("real prediction", "D", theme.real, False),
            ("ground truth", "o", theme.truth, True),
        ]
    elif data.mode == "glyph":
        marks = wedge_legend(data, model, theme)
    if model.others:
        marks.append(("not selected", ".", theme.unselected, True))
    if model.cursor is not None:
        marks.append((f"instance {model.cursor}", "o", theme.cursor, False))
    if data.clip is not None:
        marks.append(("dimmed: not seen by the selection", "s", theme.faint, False))
    return marks


PAPER_LINES_UP_TO = 200
"""Up to this number of selected instances, error lines are drawn on paper."""


def draw_predictions(axes: Axes, data: MapInput, model: MapModel, spots: Spots) -> None:
    """Draw predictions and truth of the selected, joined by lines where they are few."""
    ids, theme = model.selection.members, spots.theme
    edge = rgb_fractions(theme.background)
    _error_lines(axes, data, iids_with_error_lines(data, model, limit=PAPER_LINES_UP_TO), theme)
    shrink = 0.2 if len(ids) > MANY else 1.0
    sim, real, truth = (
        np.asarray(side, dtype=np.float64)[spots.thinned(side, ids)]
        for side in (data.sim, data.real, data.truth)
    )
    axes.scatter(
        sim[:, 0],
        sim[:, 1],
        s=20 * shrink,
        marker="D",
        linewidths=0,
        color=rgb_fractions(theme.sim),
        zorder=5,
    )
    axes.scatter(
        real[:, 0],
        real[:, 1],
        s=20 * shrink,
        marker="D",
        linewidths=1.1 * shrink,
        zorder=5,
        facecolors=[edge],
        edgecolors=[rgb_fractions(theme.real)],
    )
    gold = rgb_fractions(theme.truth)
    axes.scatter(
        truth[:, 0],
        truth[:, 1],
        s=22 * shrink,
        color=gold,
        edgecolors=[edge],
        linewidths=0.6 * shrink,
        zorder=6,
    )


def _error_lines(axes: Axes, data: MapInput, ids: np.ndarray, theme: Theme) -> None:
    from matplotlib.collections import LineCollection

    truth = np.asarray(data.truth, dtype=np.float64)[ids]
    alpha = 0.55 if len(ids) <= 40 else 0.3
    for side, colour in ((data.sim, theme.sim), (data.real, theme.real)):
        ends = np.asarray(side, dtype=np.float64)[ids]
        lines = np.stack([truth, ends], axis=1)
        lines = lines[np.isfinite(lines).all(axis=(1, 2))]
        axes.add_collection(
            LineCollection(
                list(lines), colors=[rgb_fractions(colour)], linewidths=0.7, alpha=alpha, zorder=4
            )
        )


def _draw_cursor_predictions(
    axes: Axes, data: MapInput, iid: int, theme: Theme, area: Bounds
) -> None:
    """Both predicted poses of the cursor's instance, joined to its true position."""
    _error_lines(axes, data, np.array([iid]), theme)
    draw_pose(axes, data.sim, data.sim_headings, iid, theme.sim, area)
    draw_pose(axes, data.real, data.real_headings, iid, theme.real, area)


CELL = 6.0
"""Points: the width of the cells that glyphs keep their distance by."""


FOOTPRINT = (4, 2)


RADIUS, THICK = 11.0, 4.5
"""Points."""


Span = tuple[float, float]


def draw_wedges(sheet: MapSheet, data: MapInput, model: MapModel) -> None:
    """Draw errors as wedges of sim and real; their overlap has a third colour."""
    from matplotlib.patches import Wedge

    theme, axes = sheet.page.theme, sheet.axes
    ids = model.selection.members
    truth = np.asarray(data.truth, dtype=np.float64)[sheet.spots.thinned(data.truth, ids)]
    frame = sheet.grid(CELL)
    glyph_set = error_glyphs(data, model, frame, FOOTPRINT)
    size, alpha = (1, 0.25) if glyph_set.crowded else (4, 1.0)
    gold = rgb_fractions(theme.truth)
    axes.scatter(truth[:, 0], truth[:, 1], s=size, color=gold, alpha=alpha, linewidths=0, zorder=4)
    metres = sheet.area.width / sheet.inches[0] / 72
    centres = glyph_set.centres * (frame.pitch, 2 * frame.pitch * (1 if data.y_down else -1))
    centres += (frame.x0, frame.y0)
    sim, real = (_spans(glyph_set, part) for part in (glyph_set.sim, glyph_set.real))
    for centre, size, first, second in zip(
        centres.tolist(), glyph_set.counts.tolist(), sim, real, strict=True
    ):
        for span, colour, order in (
            (first, theme.sim, 5.0),
            (second, theme.real, 5.1),
            (_shared(first, second), theme.both, 5.2),
        ):
            if span is None:
                continue
            wedge = Wedge(
                (centre[0], centre[1]),
                RADIUS * metres,
                *span,
                width=THICK * metres,
                facecolor=rgb_fractions(colour),
                edgecolor=rgb_fractions(theme.background),
                linewidth=0.5,
                zorder=order,
            )
            axes.add_patch(wedge)
        _middle(sheet, (centre[0], centre[1]), size)


def _middle(sheet: MapSheet, centre: tuple[float, float], size: int) -> None:
    """A dot for one instance, else the number of combined ones."""
    from matplotlib import patheffects

    theme = sheet.page.theme
    if size == 1:
        sheet.axes.scatter(
            [centre[0]], [centre[1]], s=12, color=rgb_fractions(theme.truth), linewidths=0, zorder=6
        )
        return
    halo: list[AbstractPathEffect] = [
        patheffects.withStroke(linewidth=2, foreground=rgb_fractions(theme.background))
    ]
    label = sheet.axes.annotate(
        str(size) if size < 1000 else f"{size // 1000}k",
        centre,
        ha="center",
        va="center",
        fontsize=6,
        fontweight="bold",
        color=rgb_fractions(theme.truth if theme.dark else theme.text),
        zorder=6,
        annotation_clip=True,
    )
    label.set_path_effects(halo)


def _spans(glyph_set: ErrorGlyphs, vectors: NDArray[np.float64]) -> list[Span | None]:
    """First and last angle of each wedge in degrees of the map; None where unknown."""
    middles = np.degrees(arc_turns(vectors, True))
    halves = np.asarray(arc_degrees(vectors, glyph_set.full)) / 2
    return [
        None if math.isnan(middle) else (middle - half, middle + half)
        for middle, half in zip(middles.tolist(), halves.tolist(), strict=True)
    ]


def _shared(first: Span | None, second: Span | None) -> Span | None:
    """The overlap of two spans of at most 180 degrees."""
    if first is None or second is None:
        return None
    turn = 360 * round((sum(first) - sum(second)) / 720)
    low, high = max(first[0], second[0] + turn), min(first[1], second[1] + turn)
    return (low, high) if high > low else None


def wedge_legend(data: MapInput, model: MapModel, theme: Theme) -> list[tuple[str, str, Rgb, bool]]:
    """The legend of the wedges."""
    full = f"{LARGEST:g}° wide = {short_number(full_scale(data), 2)} m"
    marks = [
        ("sim error", "s", theme.sim, True),
        ("real error", "s", theme.real, True),
        ("both", "s", theme.both, True),
        (full, "", theme.text, False),
        ("ground truth", "o", theme.truth, True),
    ]
    if model.highlighted > 1:
        marks.append(("number: mean of n", "", theme.text, False))
    return marks
