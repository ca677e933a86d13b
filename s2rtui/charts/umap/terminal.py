"""The embeddings in cells: sim and real side by side with the same axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from s2rtui.analysis.binning import selection_indices
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.canvas import DEFAULT_OPTIONS, Canvas, Panel, RenderOptions, Size, legible, turbo
from s2rtui.canvas.marks import draw_mark
from s2rtui.canvas.raster import cells_with_dots, draw_braille
from s2rtui.charts.shared.axis_scale import short_number, tick_step, tick_text, tick_values
from s2rtui.charts.shared.base_map_terminal import (
    draw_trained,
    plane_panel,
    several_legend,
    trained_legend,
)
from s2rtui.charts.shared.legend import LegendPart, colour_bar, ramp_for_values, text_part
from s2rtui.charts.umap.model import (
    LEVELS,
    UmapInput,
    UmapLayer,
    UmapModel,
    level_shares,
    umap_frame,
    umap_model,
)

AXES = 5
"""Columns of ticks at the left of a panel."""


@dataclass(frozen=True, slots=True)
class UmapLayout:
    """The corner of each panel in cells, sim first; both show `frame`, `width` x `height` cells.

    `room` is how wide a panel is with its ticks, `header` how many rows lie above it.
    """

    corners: tuple[tuple[int, int], ...]
    width: int
    height: int
    room: int
    header: int
    axes: bool
    frame: MapFrame


def umap_layout(data: UmapInput, size: Size) -> UmapLayout:
    """Lay out the panels side by side, or stacked where the view is higher than wide."""
    width, height = max(1, size[0]), max(1, size[1])
    stacked = 2 * height > width
    gap = 0 if stacked or width < 10 else 1
    room = width if stacked else max(1, (width - gap) // 2)
    rows = max(1, height // 2) if stacked else height
    header = 1 if rows >= 4 else 0
    axes = room >= 36 and rows >= 16
    left, below = (AXES, 1) if axes else (0, 0)
    shown = [(0, header), (0, rows + header) if stacked else (room + gap, header)]
    corners = tuple((x + left, y) for x, y in shown if x < width and y < height)
    inner, high = max(1, room - left), max(1, rows - header - below)
    frame = umap_frame(data, inner, high)
    return UmapLayout(corners, inner, high, room, header, axes, frame)


def umap_panels(
    data: UmapInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> tuple[Panel, ...]:
    """Planes "sim" and "real" in UMAP coordinates, y upwards."""
    layout = umap_layout(data, size)
    return tuple(
        plane_panel(name, *corner, layout.width, layout.height, layout.frame)
        for name, corner in zip(("sim", "real"), layout.corners, strict=False)
    )


def draw_umap(data: UmapInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS) -> Canvas:
    """The view in `size` (columns, rows)."""
    canvas = Canvas(*size, options)
    layout = umap_layout(data, (canvas.width, canvas.height))
    model = umap_model(data, layout.frame)
    panels = umap_panels(data, (canvas.width, canvas.height), options)
    for panel, layer in zip(panels, (model.sim, model.real), strict=False):
        chart = Canvas(layout.width, layout.height, options)
        _points(chart, layer)
        points = data.sim if panel.name == "sim" else data.real
        selection = selection_indices(data.selected, data.valid)
        draw_trained(chart, points, data.trained, selection, layout.frame)
        canvas.paste(chart, panel.x, panel.y)
        _cursor(canvas, panel, data, model)
        draw_mark(canvas, panel, data.mark)
        if layout.header:
            _header(canvas, panel, data, model, layout)
        if layout.axes:
            _axes(canvas, panel, layout)
    _divide(canvas, layout)
    return canvas


def _points(chart: Canvas, layer: UmapLayer) -> None:
    """Draw unselected points as grey dots, cells with selected ones as discs or digits.

    Discs show the colour of the mean, which single braille dots would not. Squares, or bold
    digits, stand for several instances.
    """
    theme = chart.theme
    if chart.options.ascii:
        held = cells_with_dots(layer.grey)
        chart.char[held] = chart.glyphs.unselected
        chart.fg[held] = theme.unselected
    else:
        draw_braille(chart, layer.grey, theme.unselected)
    highlighted = layer.level >= 0
    inks = np.empty((LEVELS + 1, 3), dtype=np.uint8)
    inks[0] = theme.text
    inks[1:] = legible(turbo(level_shares()), theme)
    ink = inks[np.maximum(layer.level, 0)]
    digits = ramp_for_values(chart.options)
    if digits is None:
        chart.char[highlighted] = chart.glyphs.selected
        chart.char[layer.several] = chart.glyphs.several
        chart.bold[highlighted] = True
    else:
        names = np.array(["?", *(digits[place * 10 // LEVELS] for place in range(LEVELS))])
        chart.char[highlighted] = names[layer.level[highlighted]]
        chart.bold[layer.several] = True
    chart.fg[highlighted] = ink[highlighted]


def _cursor(canvas: Canvas, panel: Panel, data: UmapInput, model: UmapModel) -> None:
    if model.cursor is None:
        return
    points = data.sim if panel.name == "sim" else data.real
    x, y = (float(part) for part in points[model.cursor])
    if np.isfinite([x, y]).all():
        column, row = (int(np.floor(part)) for part in panel.to_cells(x, y))
        canvas.put(column, row, *canvas.options.role("cursor"), bold=True)


def _header(
    canvas: Canvas, panel: Panel, data: UmapInput, model: UmapModel, layout: UmapLayout
) -> None:
    """Name and counts at the left; the colour bar at the right of the second panel."""
    sim = panel.name == "sim"
    layer = model.sim if sim else model.real
    left, row = panel.x + layout.width - layout.room, panel.y - 1
    glyph, colour = canvas.options.role(panel.name)
    parts = [text_part(((f"{glyph} {panel.name}", colour),))]
    counts = f"{layer.selected} of {layer.total}" if layer.total else "no coordinates"
    parts.append(text_part(((counts, canvas.theme.muted),)))
    if data.trained is not None:
        parts.append(trained_legend(canvas.options))
    if layer.several.any():
        full = several_legend(canvas.options)
        used = sum(part.width + 2 for part in parts)
        short = text_part(((f"{canvas.glyphs.several} 2+", canvas.theme.muted),))
        no_digits = ramp_for_values(canvas.options) is None
        parts.append(short if no_digits and used + full.width > layout.room else full)
    free = layout.room
    bar = None if sim else _bar(data, model, free - parts[0].width - 2, canvas.options)
    if bar is not None:
        free -= bar.width + 2
        bar.draw(canvas, left + layout.room - bar.width, row)
    for part in parts:
        if part.width <= free:
            part.draw(canvas, left, row)
            left, free = left + part.width + 2, free - part.width - 2


def _bar(data: UmapInput, model: UmapModel, room: int, options: RenderOptions) -> LegendPart | None:
    if room < 12:
        return None
    ramp, scale = ramp_for_values(options), model.value_range
    length = 10 if ramp else 8 if room < 40 else 16
    clipped = data.value_range is None
    return colour_bar(
        data.value_label, data.value_unit, scale, options, length,
        ramp=ramp, room=room, clipped=clipped,
    )  # fmt: skip


def _divide(canvas: Canvas, layout: UmapLayout) -> None:
    """A faint line between panels side by side."""
    level = len({y for _, y in layout.corners}) == 1
    if level and canvas.width > 2 * layout.room:
        canvas.vline(layout.room, 0, canvas.height - 1, canvas.glyphs.vertical, canvas.theme.faint)


def _axes(canvas: Canvas, panel: Panel, layout: UmapLayout) -> None:
    """Ticks along the left and the lower edge of a panel."""
    theme, area = canvas.theme, layout.frame.extent
    width = tick_step(area.width, max(2, panel.width // 10))
    free, stop = panel.x, panel.x + panel.width
    for tick in tick_values(area.x0, area.x1, max(2, panel.width // 10)):
        text = tick_text(tick, width) if width >= 1e-2 else short_number(tick)
        start = int(panel.to_cells(tick, area.y0)[0]) - len(text) // 2
        if start >= free and start + len(text) <= stop:
            free = canvas.text(start, panel.y + panel.height, text, theme.muted) + 1
    width = tick_step(area.height, max(2, panel.height // 4))
    for tick in tick_values(area.y0, area.y1, max(2, panel.height // 4)):
        row = int(panel.to_cells(area.x0, tick)[1])
        if panel.y <= row < panel.y + panel.height:
            text = (tick_text(tick, width) if width >= 1e-2 else short_number(tick))[: AXES - 1]
            canvas.text(panel.x - 1, row, text, theme.muted, align="right")
