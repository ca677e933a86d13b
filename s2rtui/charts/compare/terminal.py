"""The difference map: where one run errs less than another on the same selection."""

from __future__ import annotations

import numpy as np

from s2rstore.records import Bounds
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.canvas import DEFAULT_OPTIONS, Canvas, Panel, RenderOptions, Rgb, Size, legible
from s2rtui.charts.compare.model import (
    CompareInput,
    CompareModel,
    better_run,
    cell_means,
    compare_model,
    difference_colours,
)
from s2rtui.charts.shared.axis_scale import short_number
from s2rtui.charts.shared.base_map_model import default_view
from s2rtui.charts.shared.base_map_terminal import (
    MapLayout,
    draw_point_map,
    draw_pose,
    layout_of_area,
    map_legend,
    map_panel,
    put_glyphs,
    several_legend,
)
from s2rtui.charts.shared.legend import LegendPart, colour_bar, ramp_for_values, text_part

SEVERAL, ONE = "▼●▲", "▾•▴"
"""Glyphs of cells with several instances, and of those with one."""


def difference_glyphs(options: RenderOptions) -> str:
    """Three glyphs: the first run is better, equal, the second is better."""
    return "-=+" if ramp_for_values(options) is not None else SEVERAL


def compare_layout(
    data: CompareInput,
    size: Size,
    viewport: Bounds | None = None,
    options: RenderOptions = DEFAULT_OPTIONS,
    model: CompareModel | None = None,
) -> MapLayout:
    """Lay out the map in `size`; `viewport` is a world rectangle (default: the bounds)."""
    model = model or compare_model(data)
    area = viewport or default_view(data.bounds, data.truth, data.valid)

    def legend(frame: MapFrame, width: int) -> list[LegendPart]:
        return _legend(data, model, frame, width, options)

    return layout_of_area(area, data.y_down, size, legend)


def compare_panels(
    data: CompareInput,
    size: Size,
    options: RenderOptions = DEFAULT_OPTIONS,
    viewport: Bounds | None = None,
) -> tuple[Panel, ...]:
    """One panel "map", a plane of metres."""
    return (map_panel(compare_layout(data, size, viewport, options)),)


def draw_compare(
    data: CompareInput,
    size: Size,
    options: RenderOptions = DEFAULT_OPTIONS,
    viewport: Bounds | None = None,
) -> Canvas:
    """Draw the mean difference of the selected per cell in `size` (columns, rows)."""
    model = compare_model(data)
    layout = compare_layout(data, size, viewport, options, model)

    def draw_selected(chart: Canvas) -> None:
        _cells(chart, data, model, layout.frame)
        if model.cursor is not None:
            draw_pose(chart, data.truth, None, model.cursor, layout.frame, "cursor")

    return draw_point_map(data, model.selection, layout, size, options, draw_selected)


def _cells(canvas: Canvas, data: CompareInput, model: CompareModel, frame: MapFrame) -> None:
    """A glyph per cell in the colour of its mean, larger or bold for several instances."""
    columns, rows, means, counts = cell_means(
        data.truth, data.first, data.second, model.selection, frame
    )
    put_glyphs(canvas, columns, rows, " ", canvas.theme.text)
    verdict = better_run(means, data.equal) + 1
    glyphs = difference_glyphs(canvas.options)
    one = ONE if glyphs == SEVERAL else glyphs
    many = counts > 1
    canvas.char[rows, columns] = np.where(
        many, np.array(list(glyphs))[verdict], np.array(list(one))[verdict]
    )
    canvas.fg[rows, columns] = legible(difference_colours(means, model.scale), canvas.theme)
    canvas.bold[rows, columns] = many


def _legend(
    data: CompareInput, model: CompareModel, frame: MapFrame, width: int, options: RenderOptions
) -> list[LegendPart]:
    first, second = (_name(name, options) for name in data.names)
    bar = colour_bar(
        f"{data.side} error, {first} - {second}",
        data.unit,
        (-model.scale, model.scale),
        options,
        12 if width >= 50 else 8,
        colours=lambda shares: difference_colours(2 * shares - 1, 1.0),
        ramp=difference_glyphs(options) if ramp_for_values(options) is not None else None,
        room=width,
    )
    counts = _counts(data, model, (first, second), options)
    if counts.width > width:
        counts = _counts(data, model, None, options)
    rest = map_legend(frame, width, model.others, data.clip is not None, options)
    if model.highlighted > 1:
        rest.insert(0, several_legend(options, SEVERAL))
    return [counts, bar, *rest]


def _counts(
    data: CompareInput, model: CompareModel, names: tuple[str, str] | None, options: RenderOptions
) -> LegendPart:
    """How often each run is better, and the mean difference; with `names` unless None."""
    theme, summary = options.theme, model.summary
    ends = legible(difference_colours([-1.0, 0.0, 1.0], 1.0), theme)
    blue, grey, orange = ((int(r), int(g), int(b)) for r, g, b in ends)
    lower, same, upper = tuple(difference_glyphs(options))
    pieces: list[tuple[str, Rgb]] = []
    for glyph, colour, number, explanation in (
        (upper, orange, summary.improved, f" better in {names[1]}" if names else ""),
        (lower, blue, summary.worse, f" better in {names[0]}" if names else ""),
        (
            same,
            grey,
            summary.equal,
            f" within {short_number(data.equal)} {data.unit}" if names else "",
        ),
    ):
        pieces += [(f"{glyph} ", colour), (f"{number}{explanation}  ", theme.text)]
    if summary.improved + summary.worse + summary.equal:
        pieces.append((f"mean {summary.mean:+.2f} {data.unit}", theme.muted))
    return text_part(pieces)


def _name(name: str, options: RenderOptions) -> str:
    """A run's name, cut to fit into a legend."""
    name = options.printable(name)
    return name if len(name) <= 16 else name[:15] + options.glyphs.ellipsis
