"""Sim error against real error in cells."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from s2rtui.canvas import (
    DEFAULT_OPTIONS,
    Canvas,
    Panel,
    Point,
    RenderOptions,
    Rgb,
    Size,
    legible,
    turbo,
)
from s2rtui.canvas.fit_text import fit_text
from s2rtui.canvas.marks import draw_mark
from s2rtui.canvas.raster import cells_with_dots, draw_braille, line_dots
from s2rtui.charts.scatter.axis import LOG_RULE, ErrorPlane
from s2rtui.charts.scatter.model import (
    DENSITY_ABOVE,
    EQUAL,
    PERCENT,
    QUADRANTS,
    REAL_LARGER,
    SIM_LARGER,
    Limits,
    ScatterInput,
    ScatterModel,
    ScatterSummary,
    scatter_model,
    scatter_summary,
)
from s2rtui.charts.shared.legend import (
    LegendPart,
    draw_rows,
    fit_rows,
    legend_rows,
    ramp_for_values,
    text_part,
)
from s2rtui.charts.shared.trained_marks import (
    TrainedForms,
    digit_forms,
    mark_trained,
    number_forms,
    number_glyphs,
    trained_legend,
)
from s2rtui.drawing.scale import short_number

LEFT = 7
"""Columns of ticks at the left."""
_LEAST = 1e-12
"""Metres; errors below it, also 0, have the same place on a logarithmic axis."""


@dataclass(frozen=True, slots=True)
class ScatterLayout:
    """The plot's first column, its width and height in cells, and the rows of the legend below."""

    left: int
    width: int
    height: int
    axes: bool
    legend: tuple[tuple[LegendPart, ...], ...]


def scatter_layout(
    data: ScatterInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS, peak: int = 1
) -> ScatterLayout:
    """Lay out plot and legend; `peak` is the largest count of the scale of densities."""
    width, height = max(1, size[0]), max(1, size[1])
    axes = width >= 36 and height >= 12
    left, below = (LEFT, 1) if axes else (0, 0)
    rows = fit_rows(_legend(data, options, width, peak), width, most=legend_rows(height))
    legend = tuple(tuple(row) for row in rows)
    return ScatterLayout(left, width - left, height - below - len(rows), axes, legend)


def scatter_panels(
    data: ScatterInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> tuple[Panel, ...]:
    """One panel "errors", a plane: x is the sim error, y the real error, both in metres."""
    layout = scatter_layout(data, size, options)
    return (_panel(data.plane, layout),)


def _panel(plane: ErrorPlane, layout: ScatterLayout) -> Panel:
    axes = plane.across, plane.up
    least = _LEAST if plane.axis.log else -np.inf

    def to_data(column: float, row: float) -> Point:
        places = (column - layout.left) / layout.width, 1 - row / layout.height
        across, up = (axis.value(place) for axis, place in zip(axes, places, strict=True))
        return across, up

    def to_cells(x: float, y: float) -> Point:
        across, up = (
            float(axis.fractions(max(error, least)))
            for axis, error in zip(axes, (x, y), strict=True)
        )
        return layout.left + across * layout.width, (1 - up) * layout.height

    return Panel("errors", "plane", layout.left, 0, layout.width, layout.height, to_data, to_cells)


def draw_scatter(
    data: ScatterInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> Canvas:
    """Draw the plot in `size` (columns, rows)."""
    canvas = Canvas(*size, options)
    size = canvas.width, canvas.height
    layout = scatter_layout(data, size, options)
    model = scatter_model(data, layout.width, layout.height)
    if model.dense:
        layout = scatter_layout(data, size, options, model.peak)
    chart = Canvas(layout.width, layout.height, options)
    _lines(chart, model)
    _unselected(chart, model)
    (_shades if model.dense else _dots)(chart, model)
    if model.trained is not None:
        mark_trained(chart, model.trained, trained_forms(options, model.dense))
        if model.dense:
            chart.fg[model.trained] = chart.theme.text
    if model.cursor is not None:
        across = float(data.plane.drawn_across(data.sim[model.cursor]))
        up = float(data.plane.drawn_up(data.real[model.cursor]))
        column, row = math.floor(across * layout.width), math.floor(up * layout.height)
        chart.put(column, layout.height - 1 - row, *options.role("cursor"), bold=True)
    canvas.paste(chart, layout.left, 0)
    panel = _panel(data.plane, layout)
    draw_mark(canvas, panel, data.mark)
    if layout.axes:
        _axes(canvas, panel, data)
    draw_rows(canvas, 0, layout.height + int(layout.axes), layout.legend)
    return canvas


def _lines(chart: Canvas, model: ScatterModel) -> None:
    """The diagonal, and a line at each limit of the best and the worst 15 %."""
    glyphs, ink, plane = chart.glyphs, chart.theme.faint, model.plane
    for limits, vertical in ((model.summary.sim, True), (model.summary.real, False)):
        for limit in (limits.best, limits.worst):
            if not np.isfinite(limit):
                continue
            place = float((plane.drawn_across if vertical else plane.drawn_up)(limit))
            if not 0 <= place < 1:
                continue
            if vertical:
                chart.vline(int(place * chart.width), 0, chart.height - 1, glyphs.vertical, ink)
            else:
                row = chart.height - 1 - int(place * chart.height)
                chart.hline(0, chart.width - 1, row, glyphs.horizontal, ink)
    shown = plane.shown
    left, right = (
        (
            (end - shown.x0) / shown.width * chart.width,
            (1 - (end - shown.y0) / shown.height) * chart.height,
        )
        for end in (0.0, 1.0)
    )
    diagonal = cells_with_dots(line_dots([(left, right)], chart.width, chart.height))
    chart.char[diagonal] = diagonal_glyph(chart.options)
    chart.fg[diagonal] = chart.theme.both


def diagonal_glyph(options: RenderOptions) -> str:
    """The glyph of the line on which both errors are equal."""
    return "/" if options.ascii else "╱"


def side_glyphs(options: RenderOptions) -> str:
    """Glyphs of one instance whose sim error is larger, whose errors are equal, real is larger."""
    glyphs = options.glyphs
    return glyphs.sim + glyphs.both + glyphs.real


def trained_forms(options: RenderOptions, dense: bool) -> TrainedForms:
    """The forms of trained instances; in `dense` plots those of the digits of densities."""
    return digit_forms(options) if dense else number_forms(options, side_glyphs(options))


def _unselected(chart: Canvas, model: ScatterModel) -> None:
    theme = chart.theme
    if chart.options.ascii:
        held = cells_with_dots(model.grey)
        chart.char[held] = chart.glyphs.unselected
        chart.fg[held] = theme.unselected
    else:
        draw_braille(chart, model.grey, theme.unselected)


def _dots(chart: Canvas, model: ScatterModel) -> None:
    """The glyph of the larger error for one selected instance, a number for several."""
    held, one = model.count > 0, model.count == 1
    chart.char[held] = number_glyphs(model.count[held], chart.glyphs.selected)
    chart.char[one] = np.array(list(side_glyphs(chart.options)))[model.larger[one]]
    chart.fg[held] = _side_inks(chart.options)[model.larger[held]]
    chart.bold[held] = True


def _side_inks(options: RenderOptions) -> np.ndarray:
    """(3, 3) colours by side of the diagonal: the sim error is larger, both, the real error is."""
    theme = options.theme
    inks = np.empty((3, 3), dtype=np.uint8)
    inks[SIM_LARGER], inks[EQUAL], inks[REAL_LARGER] = theme.sim, theme.text, theme.real
    return inks


def _shades(chart: Canvas, model: ScatterModel) -> None:
    """Cells with selected instances in the colour, or the shade, of their number."""
    held = model.count > 0
    shares = density_shares(model.count[held], model.peak)
    ramp = ramp_for_values(chart.options)
    if ramp is None:
        chart.char[held] = " "
        chart.bg[held] = legible(turbo(shares), chart.theme)
        return
    places = np.minimum((shares * len(ramp)).astype(np.intp), len(ramp) - 1)
    chart.char[held] = np.array(list(ramp))[places]
    chart.fg[held] = legible(turbo(shares), chart.theme)
    chart.bold[held] = True


def density_shares(counts: np.ndarray, peak: int) -> np.ndarray:
    """Counts from 1 as fractions 0 .. 1 of a logarithmic scale that ends at `peak`."""
    return np.asarray(np.log(counts) / max(np.log(peak), 1e-9))


def _axes(canvas: Canvas, panel: Panel, data: ScatterInput) -> None:
    """Ticks along the left and the lower edge, with the names of both axes."""
    theme, across, up, bottom = canvas.theme, data.plane.across, data.plane.up, panel.height
    name = f"sim error {data.unit}{', log' if data.axis.log else ''}"
    free, stop = panel.x, canvas.width - len(name) - 1
    for tick in across.ticks(max(2, panel.width // 8)):
        text = short_number(tick)
        start = max(panel.x, int(panel.to_cells(tick, up.high)[0]) - len(text) // 2)
        if start >= free and start + len(text) <= stop:
            free = canvas.text(start, bottom, text, theme.muted) + 1
    canvas.text(canvas.width - len(name), bottom, name, theme.muted)
    canvas.text(0, 0, f"real {data.unit}", theme.muted)
    for tick in up.ticks(max(2, panel.height // 4)):
        row = min(int(panel.to_cells(across.high, tick)[1]), bottom - 1)
        if row >= 1:
            text = fit_text(short_number(tick), LEFT - 1)
            canvas.text(panel.x - 1, row, text, theme.muted, align="right")


def _legend(data: ScatterInput, options: RenderOptions, width: int, peak: int) -> list[LegendPart]:
    """What colours, glyphs and lines mean, with the counts of the corners."""
    summary, theme = scatter_summary(data), options.theme
    parts = _point_legend(data, summary, options, width, peak)
    lines = f"lines: best and worst {PERCENT} %"
    limits = lines + _limits_text(summary.sim, summary.real)
    lines = limits if len(limits) <= width else lines
    diagonal = (f"{diagonal_glyph(options)} ", theme.both), ("sim = real", theme.muted)
    parts[2:2] = [text_part(diagonal), text_part(((lines, theme.muted),))]
    parts += [
        text_part(((f"{quadrant.name}: ", theme.muted), (str(count), theme.text)))
        for quadrant, (count, _) in zip(QUADRANTS[:2], summary.quadrants, strict=False)
    ]
    if data.axis.log:
        below = f"; {summary.below} below {short_number(data.axis.low)} {data.unit} at the edge"
        text = f"log axes: {LOG_RULE}{below if summary.below else ''}"
        short = f"log axes{below if summary.below else ''}"
        part = text_part(((text if len(text) <= width else short, theme.muted),))
        parts.insert(2 if summary.below else len(parts), part)  # errors at the edge are not lost
    else:
        parts.append(text_part((("linear axes", theme.muted),)))
    return parts


def _point_legend(
    data: ScatterInput, summary: ScatterSummary, options: RenderOptions, width: int, peak: int
) -> list[LegendPart]:
    theme = options.theme
    parts: list[LegendPart] = []
    sides = (("real", theme.real, summary.real_larger), ("sim", theme.sim, summary.sim_larger))
    dense = summary.total > DENSITY_ABOVE
    for side, ink, count in sides:
        where = "above" if side == "real" else "below"
        marked: list[tuple[str, Rgb]] = [] if dense else [(f"{options.role(side)[0]} ", ink)]
        text = f"{side} error larger ({where} the diagonal): "
        if len(text) + 12 > width // 2:
            text = f"{side} error larger: "
        parts.append(text_part((*marked, (text, theme.muted), (str(count), theme.text))))
    if dense:
        parts.insert(0, _count_bar(peak, options))
    elif summary.selected:
        parts.append(text_part((("2-9: that many instances, +: 10 or more", theme.muted),)))
    if data.trained is not None:
        plain = dense and ramp_for_values(options) is None
        parts.append(trained_legend(options, None if plain else trained_forms(options, dense)))
    if summary.selected < summary.total:
        grey = "⠿" if not options.ascii else options.glyphs.unselected
        parts.append(text_part(((f"{grey} ", theme.unselected), ("not selected", theme.muted))))
    return parts


def _count_bar(peak: int, options: RenderOptions) -> LegendPart:
    """The logarithmic scale of densities from 1 to `peak`."""
    length, muted = 10, options.theme.muted
    glyphs = ramp_for_values(options) or "█" * length
    inks = legible(turbo(np.linspace(0, 1, length)), options.theme).tolist()
    shades = [(glyph, (r, g, b)) for glyph, (r, g, b) in zip(glyphs, inks, strict=True)]
    return text_part((("instances per cell, log: 1 ", muted), *shades, (f" {peak}", muted)))


def _limits_text(sim: Limits, real: Limits) -> str:
    """The limits of both sides in metres; empty where they are unknown."""
    if not np.isfinite([sim.best, sim.worst, real.best, real.worst]).all():
        return ""
    sides = (("sim", sim), ("real", real))
    return "".join(
        f", {name} to {short_number(limits.best, 2)} and from {short_number(limits.worst, 2)} m"
        for name, limits in sides
    )
