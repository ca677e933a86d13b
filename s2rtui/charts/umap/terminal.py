"""The embeddings in cells: sim and real side by side with the same axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import Bools, selection_indices
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.canvas import (
    DEFAULT_OPTIONS,
    UNICODE,
    Canvas,
    Panel,
    RenderOptions,
    Size,
    legible,
    mix,
    turbo,
)
from s2rtui.canvas.marks import draw_mark
from s2rtui.canvas.raster import braille_bits, cells_with_dots
from s2rtui.charts.shared.base_map_terminal import (
    plane_panel,
    point_colours,
    several_legend,
)
from s2rtui.charts.shared.legend import (
    LegendPart,
    colour_bar,
    draw_rows,
    fit_rows,
    legend_rows,
    ramp_for_values,
    text_part,
)
from s2rtui.charts.shared.points import marked_cells
from s2rtui.charts.shared.trained_marks import (
    TrainedForms,
    digit_forms,
    mark_trained,
    number_forms,
    number_glyphs,
    trained_legend,
)
from s2rtui.charts.umap.model import (
    LEVELS,
    UmapInput,
    UmapLayer,
    UmapModel,
    level_shares,
    umap_frame,
    umap_model,
    value_range,
)
from s2rtui.drawing.scale import short_number, tick_step, tick_text, tick_values

SINGLE = 8
"""Up to this number of instances a cell shows each as a braille dot, above it a shade."""
SHADE_STEPS = (SINGLE + 1, 65, 513, 4097)
"""Numbers of instances from which a cell has each shade."""


def _dots_of_counts() -> NDArray[np.uint32]:
    """(256, SINGLE + 1): the bits of a cell with as many dots as instances.

    Instances in one place of the cell take free places from the first on.
    """
    table = np.zeros((256, SINGLE + 1), dtype=np.uint32)
    for bits in range(256):
        for count in range(SINGLE + 1):
            filled = bits
            while filled.bit_count() < count:
                filled |= ~filled & (filled + 1)
            table[bits, count] = filled
    return table


_DOTS = _dots_of_counts()
_GROUND = 0.3
"""Opacity of the colour behind shades, and behind the dots of selected instances."""
AXES = 5
"""Columns of ticks at the left of a panel."""


@dataclass(frozen=True, slots=True)
class UmapLayout:
    """The corner of each panel in cells, sim first; both show `frame`, `width` x `height` cells.

    `room` is how wide a panel is with its ticks, `header` how many rows lie above it. `legend`
    holds the rows below the panels.
    """

    corners: tuple[tuple[int, int], ...]
    width: int
    height: int
    room: int
    header: int
    axes: bool
    frame: MapFrame
    legend: tuple[tuple[LegendPart, ...], ...]


def umap_layout(
    data: UmapInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> UmapLayout:
    """Lay out the panels side by side, or stacked where the view is higher than wide."""
    width, height = max(1, size[0]), max(1, size[1])
    legend = fit_rows(_legend(data, width, options), width, most=legend_rows(height))
    height -= len(legend)
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
    rows_below = tuple(tuple(row) for row in legend)
    return UmapLayout(corners, inner, high, room, header, axes, frame, rows_below)


def umap_panels(
    data: UmapInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> tuple[Panel, ...]:
    """Planes "sim" and "real" in UMAP coordinates, y upwards."""
    layout = umap_layout(data, size, options)
    return tuple(
        plane_panel(name, *corner, layout.width, layout.height, layout.frame)
        for name, corner in zip(("sim", "real"), layout.corners, strict=False)
    )


def draw_umap(data: UmapInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS) -> Canvas:
    """The view in `size` (columns, rows)."""
    canvas = Canvas(*size, options)
    layout = umap_layout(data, (canvas.width, canvas.height), options)
    model = umap_model(data, layout.frame)
    panels = umap_panels(data, (canvas.width, canvas.height), options)
    for panel, layer in zip(panels, (model.sim, model.real), strict=False):
        chart = Canvas(layout.width, layout.height, options)
        _points(chart, layer)
        points = data.sim if panel.name == "sim" else data.real
        selection = selection_indices(data.selected, data.valid)
        if data.trained is not None:
            cells = marked_cells(points, data.trained, selection, layout.frame)
            _trained(chart, layer, cells)
        canvas.paste(chart, panel.x, panel.y)
        _cursor(canvas, panel, data, model)
        draw_mark(canvas, panel, data.mark)
        if layout.header:
            _header(canvas, panel, model, layout)
        if layout.axes:
            _axes(canvas, panel, layout)
    _divide(canvas, layout)
    draw_rows(canvas, 0, canvas.height - len(layout.legend), layout.legend)
    return canvas


def _points(chart: Canvas, layer: UmapLayer) -> None:
    """Draw each cell with instances: braille dots of few, a shade of many, digits for values.

    Cells with selected instances show these alone, in the colour of their mean.
    """
    theme, options = chart.theme, chart.options
    highlighted, held = layer.level >= 0, layer.count > 0
    inks = np.empty((LEVELS + 1, 3), dtype=np.uint8)
    inks[0] = theme.text
    inks[1:] = legible(turbo(level_shares()), theme)
    chart.fg[held] = theme.unselected
    chart.fg[highlighted] = inks[layer.level[highlighted]]
    if options.ascii:
        chart.char[cells_with_dots(layer.grey)] = chart.glyphs.unselected
    else:
        single = held & (layer.count <= SINGLE)
        bits = _DOTS[braille_bits(layer.dots)[single], layer.count[single]]
        chart.char[single] = (0x2800 + bits).astype(np.uint32).view("<U1")
        steps = np.digitize(layer.count, SHADE_STEPS)
        many = held & ~single
        chart.char[many] = np.array(list(UNICODE.shades))[steps[many]]
        tinted = (highlighted | many) if options.supports_images else many & False
        chart.bg[tinted] = mix(theme.background, chart.fg[tinted], _GROUND)
    digits = ramp_for_values(options)
    if digits is not None:
        names = np.array(["?", *(digits[place * 10 // LEVELS] for place in range(LEVELS))])
        chart.char[highlighted] = names[layer.level[highlighted]]
        chart.bold[highlighted & (layer.count > 1)] = True


def _forms(options: RenderOptions) -> TrainedForms:
    """The forms of trained instances: of the digits that stand for values, or of numbers."""
    if ramp_for_values(options) is not None:
        return digit_forms(options)
    return number_forms(options, options.glyphs.selected)


def _trained(chart: Canvas, layer: UmapLayer, cells: Bools) -> None:
    """Mark cells (h, w) with trained instances; their dots and shades become numbers."""
    if ramp_for_values(chart.options) is None:
        chart.char[cells] = number_glyphs(layer.count[cells], chart.glyphs.selected)
    mark_trained(chart, cells, _forms(chart.options))


def _legend(data: UmapInput, width: int, options: RenderOptions) -> list[LegendPart]:
    """The colour bar, and what a cell shows."""
    theme, ramp = options.theme, ramp_for_values(options)
    length = 10 if ramp else 8 if width < 60 else 16
    scale, clipped = value_range(data), data.value_range is None
    bar = colour_bar(
        data.value_label, data.value_unit, scale, options, length, point_colours(theme),
        ramp=ramp, room=width, clipped=clipped,
    )  # fmt: skip
    mean = "digit" if ramp else "colour"
    grey = options.glyphs.unselected if options.ascii else "⠿"
    parts = [
        bar,
        text_part(((f"{mean}: mean of the selected", theme.muted),)),
        text_part(((f"{grey} ", theme.unselected), ("none selected", theme.muted))),
    ]
    if data.trained is not None:
        parts.append(trained_legend(options, _forms(options)))
    if ramp is not None:
        parts.append(several_legend(options))
    if not options.ascii:
        most = int(np.count_nonzero(data.valid))
        texts = [f"⠿ 1 to {SINGLE}"]
        texts += [
            f"{shade} {least}+"
            for shade, least in zip(options.glyphs.shades[1:], SHADE_STEPS, strict=True)
            if least <= most
        ]
        parts.append(text_part((("  ".join(texts) + " per cell", theme.muted),)))
    return parts


def _cursor(canvas: Canvas, panel: Panel, data: UmapInput, model: UmapModel) -> None:
    if model.cursor is None:
        return
    points = data.sim if panel.name == "sim" else data.real
    x, y = (float(part) for part in points[model.cursor])
    if np.isfinite([x, y]).all():
        column, row = (int(np.floor(part)) for part in panel.to_cells(x, y))
        canvas.put(column, row, *canvas.options.role("cursor"), bold=True)


def _header(canvas: Canvas, panel: Panel, model: UmapModel, layout: UmapLayout) -> None:
    """Name and counts of a panel."""
    layer = model.sim if panel.name == "sim" else model.real
    left, row = panel.x + layout.width - layout.room, panel.y - 1
    glyph, colour = canvas.options.role(panel.name)
    counts = f"{layer.selected} of {layer.total}" if layer.total else "no coordinates"
    parts = [
        text_part(((f"{glyph} {panel.name}", colour),)),
        text_part(((counts, canvas.theme.muted),)),
    ]
    draw_rows(canvas, left, row, fit_rows(parts, layout.room, most=1))


def _divide(canvas: Canvas, layout: UmapLayout) -> None:
    """A faint line between panels side by side."""
    level = len({y for _, y in layout.corners}) == 1
    if level and canvas.width > 2 * layout.room:
        canvas.vline(
            layout.room,
            0,
            canvas.height - len(layout.legend) - 1,
            canvas.glyphs.vertical,
            canvas.theme.faint,
        )


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
    for tick, text in _left_ticks(area.y0, area.y1, panel.height):
        row = int(panel.to_cells(area.x0, tick)[1])
        if panel.y <= row < panel.y + panel.height:
            canvas.text(panel.x - 1, row, text, theme.muted, align="right")


def _left_ticks(low: float, high: float, height: int) -> list[tuple[float, str]]:
    """Ticks of the vertical axis whose labels fit uncut; none if no label fits."""
    for count in range(max(2, height // 4), 0, -1):
        width = tick_step(high - low, count)
        ticks = tick_values(low, high, count)
        texts = [tick_text(tick, width) if width >= 1e-2 else short_number(tick) for tick in ticks]
        if all(len(text) < AXES for text in texts):
            return list(zip(ticks, texts, strict=True))
    return []
