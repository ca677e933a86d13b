"""Mode "glyph" of the geo-map on paper: two wedges of a ring around each point."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from s2rtui.canvas.colour import Rgb, Theme
from s2rtui.charts.map.model import (
    LARGEST,
    ErrorGlyphs,
    arc_degrees,
    arc_turns,
    error_glyphs,
    full_scale,
)
from s2rtui.charts.shared.axis_scale import short
from s2rtui.charts.shared.inputs import GeoMapInput
from s2rtui.charts.shared.map_model import GeoMapModel
from s2rtui.charts.shared.paper import unit
from s2rtui.charts.shared.paper_map import MapSheet

if TYPE_CHECKING:
    from matplotlib.patheffects import AbstractPathEffect

CELL = 6.0
"""Points: the width of the cells that glyphs keep their distance by."""
FOOTPRINT = (4, 2)
RADIUS, THICK = 11.0, 4.5
"""Points."""
Span = tuple[float, float]


def draw_wedges(sheet: MapSheet, view: GeoMapInput, model: GeoMapModel) -> None:
    """Sim and real wedges, overlapping parts in a colour of their own."""
    from matplotlib.patches import Wedge

    theme, axes = sheet.page.theme, sheet.axes
    ids = model.chosen.members
    truth = np.asarray(view.truth, dtype=np.float64)[sheet.spots.kept(view.truth, ids)]
    frame = sheet.grid(CELL)
    found = error_glyphs(view, model, frame, FOOTPRINT)
    size, alpha = (1, 0.25) if found.crowded else (4, 1.0)
    gold = unit(theme.truth)
    axes.scatter(truth[:, 0], truth[:, 1], s=size, color=gold, alpha=alpha, linewidths=0, zorder=4)
    metres = sheet.area.width / sheet.inches[0] / 72
    centres = found.centres * (frame.pitch, 2 * frame.pitch * (1 if view.y_down else -1))
    centres += (frame.x0, frame.y0)
    sim, real = (_spans(found, part) for part in (found.sim, found.real))
    for centre, size, first, second in zip(
        centres.tolist(), found.counts.tolist(), sim, real, strict=True
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
                facecolor=unit(colour),
                edgecolor=unit(theme.background),
                linewidth=0.5,
                zorder=order,
            )
            axes.add_patch(wedge)
        _middle(sheet, (centre[0], centre[1]), size)


def _middle(sheet: MapSheet, centre: tuple[float, float], size: int) -> None:
    """A dot for one instance, else how many are taken together."""
    from matplotlib import patheffects

    theme = sheet.page.theme
    if size == 1:
        sheet.axes.scatter(
            [centre[0]], [centre[1]], s=12, color=unit(theme.truth), linewidths=0, zorder=6
        )
        return
    halo: list[AbstractPathEffect] = [
        patheffects.withStroke(linewidth=2, foreground=unit(theme.background))
    ]
    label = sheet.axes.annotate(
        str(size) if size < 1000 else f"{size // 1000}k",
        centre,
        ha="center",
        va="center",
        fontsize=6,
        fontweight="bold",
        color=unit(theme.truth if theme.dark else theme.text),
        zorder=6,
        annotation_clip=True,
    )
    label.set_path_effects(halo)


def _spans(found: ErrorGlyphs, vectors: NDArray[np.float64]) -> list[Span | None]:
    """First and last angle of each wedge in the map's own degrees; None where unknown."""
    middles = np.degrees(arc_turns(vectors, True))
    halves = np.asarray(arc_degrees(vectors, found.full)) / 2
    return [
        None if math.isnan(middle) else (middle - half, middle + half)
        for middle, half in zip(middles.tolist(), halves.tolist(), strict=True)
    ]


def _shared(first: Span | None, second: Span | None) -> Span | None:
    """Where two spans of at most half a turn overlap."""
    if first is None or second is None:
        return None
    turn = 360 * round((sum(first) - sum(second)) / 720)
    low, high = max(first[0], second[0] + turn), min(first[1], second[1] + turn)
    return (low, high) if high > low else None


def wedge_legend(
    view: GeoMapInput, model: GeoMapModel, theme: Theme
) -> list[tuple[str, str, Rgb, bool]]:
    """What the wedges' colours, widths and numbers mean."""
    full = f"{LARGEST:g}° wide = {short(full_scale(view), 2)} m"
    marks = [
        ("sim error", "s", theme.sim, True),
        ("real error", "s", theme.real, True),
        ("both", "s", theme.both, True),
        (full, "", theme.text, False),
        ("ground truth", "o", theme.truth, True),
    ]
    if model.lit > 1:
        marks.append(("number: mean of n", "", theme.text, False))
    return marks
