"""Where a map stands among its axes and legend, and how its cells become metres."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from s2rstore.records import Bounds
from s2rtui.analysis.map_frame import MapFrame, fit
from s2rtui.canvas.brush import Panel, Point
from s2rtui.canvas.canvas import Canvas, Size
from s2rtui.canvas.render_options import RenderOptions
from s2rtui.charts.shared.axis_scale import step, tick_text, ticks
from s2rtui.charts.shared.legend import LegendPart, flow

Legend = Callable[[MapFrame, int], list[LegendPart]]
"""The parts of a legend for a frame, each within a width."""


@dataclass(frozen=True, slots=True)
class GeoMapLayout:
    """The map's rectangle in cells, its frame in the world, and the legend's rows under it."""

    x: int
    y: int
    width: int
    height: int
    frame: MapFrame
    axes: bool
    legend: tuple[tuple[LegendPart, ...], ...]


def map_layout(area: Bounds, y_down: bool, size: Size, legend: Legend) -> GeoMapLayout:
    """The place of a map of `area`; larger views have axes and up to two rows of legend."""
    width, height = max(1, size[0]), max(1, size[1])
    axes = width >= 40 and height >= 12
    left, below = (4, 1) if axes else (0, 0)
    inner = max(1, width - left)
    rough = fit(area, inner, 2 * height, y_down)
    rows = flow(legend(rough, inner), inner)[: 0 if height < 6 else 1 if height < 18 else 2]
    rows_high = max(1, height - below - len(rows))
    frame = fit(area, inner, 2 * rows_high, y_down)
    return GeoMapLayout(left, 0, inner, rows_high, frame, axes, tuple(tuple(row) for row in rows))


def map_panel(layout: GeoMapLayout) -> Panel:
    """The map as a plane of metres."""
    frame = layout.frame

    def to_data(column: float, row: float) -> Point:
        return frame.to_world(column - layout.x - 0.5, row - layout.y - 0.5)

    def to_cells(x: float, y: float) -> Point:
        column, row = frame.to_cells([[x, y]])[0].tolist()
        return column + layout.x, row + layout.y

    place = layout.x, layout.y, layout.width, layout.height
    return Panel("map", "plane", *place, to_data, to_cells)


def draw_axes(canvas: Canvas, layout: GeoMapLayout, look: RenderOptions) -> None:
    """Ticks in metres along the left and the lower edge."""
    theme, frame = look.theme, layout.frame
    extent, bottom = frame.extent, layout.height
    count = max(2, layout.width // 12)
    width = step(extent.width, count)
    canvas.text(0, 0, "y m", theme.muted)
    name = "x m"
    free, stop = layout.x, canvas.width - len(name) - 1
    for tick in ticks(extent.x0, extent.x1, count):
        column = layout.x + int(frame.to_cells([[tick, frame.y0]])[0, 0])
        text = tick_text(tick, width)
        start = column - len(text) // 2
        if start >= free and start + len(text) <= stop:
            free = canvas.text(start, bottom, text, theme.muted) + 1
    canvas.text(canvas.width - len(name), bottom, name, theme.muted)
    count = max(2, layout.height // 5)
    width = step(extent.height, count)
    for tick in ticks(extent.y0, extent.y1, count):
        row = int(frame.to_cells([[frame.x0, tick]])[0, 1])
        if 1 <= row < bottom:
            canvas.text(layout.x - 1, row, tick_text(tick, width)[:4], theme.muted, align="right")
