"""The difference map on paper: which of two runs errs less, and where."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from s2rstore.records import Bounds
from s2rtui.canvas.colour import LIGHT, Rgb, Theme
from s2rtui.charts.compare.model import DifferenceModel, by_size, difference_model, verdicts
from s2rtui.charts.compare.terminal import tint
from s2rtui.charts.map.paper_points import draw_others
from s2rtui.charts.shared.axis_scale import short
from s2rtui.charts.shared.inputs import DifferenceInput
from s2rtui.charts.shared.map_model import default_view
from s2rtui.charts.shared.paper import Pixels, colour_scale, page_of, unit, written
from s2rtui.charts.shared.paper_map import MANY, MapSheet, map_sheet, marker_legend

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MARKERS = {1: "^", 0: "o", -1: "v"}


def difference_figure(
    view: DifferenceInput,
    size: Pixels = (1600, 1200),
    theme: Theme = LIGHT,
    title: str = "",
    subtitle: str = "",
    viewport: Bounds | None = None,
) -> bytes:
    """A PNG of `size` pixels: each selected instance by its difference, the largest on top."""
    page = page_of(size, theme)
    model = difference_model(view)
    area = viewport or default_view(view.bounds, view.truth, view.valid)
    first, second = view.names
    title = title or f"{view.side.capitalize()} error: {first} against {second}"
    sheet = map_sheet(view.ground, area, page, title, subtitle)
    draw_difference(sheet, view, model)
    if sheet.side:
        difference_legend(sheet, view, model, sheet.side)
    return written(sheet.figure, page)


def draw_difference(sheet: MapSheet, view: DifferenceInput, model: DifferenceModel) -> None:
    """The unselected, the differences on top of them, the cursor."""
    draw_others(sheet.axes, view.truth, model.chosen, sheet.spots)
    _signs(sheet, view, model)
    if model.cursor is not None:
        _cursor(sheet.axes, view, model.cursor, sheet.page.theme)


def _signs(sheet: MapSheet, view: DifferenceInput, model: DifferenceModel) -> None:
    """Triangles up where the second run is better, down where the first is, dots where equal."""
    ids, apart = by_size(view, model)
    held = sheet.spots.last(view.truth, ids)
    truth, apart = np.asarray(view.truth, dtype=np.float64)[ids[held]], apart[held]
    which = verdicts(apart, view.equal)
    ink = tint(apart, model.scale) / 255.0
    few = len(held) <= MANY
    for order, verdict in enumerate((0, -1, 1)):
        part = which == verdict
        sheet.axes.scatter(
            truth[part, 0],
            truth[part, 1],
            s=34 if few else 5,
            marker=MARKERS[verdict],
            c=ink[part],
            edgecolors=[unit(sheet.page.theme.background)],
            linewidths=0.6 if few else 0,
            zorder=5 + order / 10,
        )


def _cursor(axes: Axes, view: DifferenceInput, iid: int, theme: Theme) -> None:
    x, y = (float(part) for part in np.asarray(view.truth)[iid])
    ink = unit(theme.cursor)
    axes.scatter([x], [y], s=80, facecolors="none", edgecolors=[ink], linewidths=1.6, zorder=7)


def difference_legend(
    sheet: MapSheet,
    view: DifferenceInput,
    model: DifferenceModel,
    corner: tuple[float, float],
    high: float = 0.0,
    keys: float | None = None,
) -> None:
    """The scale, who is better how often, and the mean difference.

    `high`: the scale's inches (0: what the page allows), `keys`: where the keys begin at the left.
    """
    left, top = corner
    high = high or min(2.0, (top - 0.6) * 0.42)
    box = sheet.page.box(left, top - 0.52 - high, 0.16, high)
    label = f"{view.names[0]} −\n{view.names[1]} ({view.unit})"
    ends = (-model.scale, model.scale)
    colour_scale(
        sheet.figure, sheet.page, box, ends, label, lambda shares: tint(2 * shares - 1, 1.0)
    )
    theme, summary = sheet.page.theme, model.summary
    blue, grey, orange = ((int(r), int(g), int(b)) for r, g, b in tint([-1.0, 0.0, 1.0], 1.0))
    marks: list[tuple[str, str, Rgb, bool]] = [
        (f"{summary.improved} better in {view.names[1]}", "^", orange, True),
        (f"{summary.worse} better in {view.names[0]}", "v", blue, True),
        (f"{summary.equal} within {short(view.equal)} {view.unit}", "o", grey, True),
    ]
    if summary.improved + summary.worse + summary.equal:
        marks.append((f"mean {summary.mean:+.2f} {view.unit}", "", theme.text, False))
    if model.others:
        marks.append(("not selected", ".", theme.unselected, True))
    if model.cursor is not None:
        marks.append((f"instance {model.cursor}", "o", theme.cursor, False))
    marker_legend(sheet, marks, (left if keys is None else keys, top - 0.52 - high - 0.25))
