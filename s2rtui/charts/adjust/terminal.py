"""Sliders in cells: a line per adjustment with range, neutral value and value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from s2rtui.canvas import DEFAULT_OPTIONS, Canvas, PlotArea, RenderOptions, Size
from s2rtui.canvas.fit_text import fit_text
from s2rtui.drawing.scale import short_number

_INDENT = 4
_FIGURES = 5
"""Characters of a value: `-0.05`."""
_TRACK = 8


@dataclass(frozen=True, slots=True)
class SliderLine:
    """A slider; its colour is that of `side`."""

    label: str
    side: str
    lowest: float
    highest: float
    neutral: float
    value: float
    unit: str = ""
    active: bool = False

    @property
    def moved(self) -> bool:
        return self.value != self.neutral

    def share(self, value: float) -> float:
        """A value as a fraction of the range."""
        return (value - self.lowest) / max(self.highest - self.lowest, 1e-12)


@dataclass(frozen=True, slots=True)
class SliderLayout:
    """Columns of the tracks, and the first visible line with the number of lines."""

    track: int
    track_width: int
    first: int
    shown: int


def slider_layout(lines: Sequence[SliderLine], size: Size) -> SliderLayout:
    """Lay out labels, tracks and values; the active line is always visible."""
    width, height = size
    label = _INDENT + max((len(line.label) for line in lines), default=0) + 1
    value = _FIGURES + max((len(line.unit) for line in lines), default=0) + 2
    label = min(label, max(_INDENT, width - value - _TRACK))
    track = max(_TRACK, width - label - value)
    active = next((at for at, line in enumerate(lines) if line.active), 0)
    first = min(max(0, active - height + 1), max(0, len(lines) - height))
    return SliderLayout(label, track, first, min(height, len(lines) - first))


def draw_sliders(
    lines: Sequence[SliderLine], size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> Canvas:
    """The view in `size` (columns, rows)."""
    canvas = Canvas(*size, options)
    layout = slider_layout(lines, (canvas.width, canvas.height))
    for row in range(layout.shown):
        _line(canvas, row, lines[layout.first + row], layout)
    return canvas


def _line(canvas: Canvas, y: int, line: SliderLine, layout: SliderLayout) -> None:
    theme, glyphs = canvas.theme, canvas.glyphs
    mark, side = canvas.options.role(line.side)
    if line.active:
        canvas.fill(0, y, canvas.width, 1, theme.highlight)
        canvas.put(0, y, glyphs.pointer, theme.text, bold=True)
    canvas.put(2, y, mark, side)
    label = fit_text(line.label, layout.track - _INDENT - 1)
    canvas.text(_INDENT, y, label, theme.text, bold=line.active)
    end = layout.track + layout.track_width - 1
    canvas.hline(layout.track, end, y, glyphs.horizontal, theme.faint)
    neutral, here = (_column(line.share(v), layout) for v in (line.neutral, line.value))
    if line.moved:
        canvas.hline(min(neutral, here), max(neutral, here), y, glyphs.bar, side)
    canvas.put(neutral, y, glyphs.vertical, theme.muted)
    canvas.put(here, y, glyphs.selected, side if line.moved else theme.text, bold=True)
    text = f" {short_number(line.value)} {line.unit}".rstrip()
    canvas.text(end + 1, y, text, theme.text if line.moved else theme.muted, bold=line.moved)


def _column(share: float, layout: SliderLayout) -> int:
    return layout.track + round(min(max(share, 0.0), 1.0) * (layout.track_width - 1))


def slider_panels(lines: Sequence[SliderLine], size: Size) -> tuple[PlotArea, ...]:
    """A panel per visible slider, named by its index; x is the slider's value."""
    layout = slider_layout(lines, size)
    panels = []
    for row in range(layout.shown):
        index = layout.first + row
        line = lines[index]
        data = partial(_to_data, line, layout, row)
        cells = partial(_to_cells, line, layout, row)
        panels.append(
            PlotArea(str(index), "range", layout.track, row, layout.track_width, 1, data, cells)
        )
    return tuple(panels)


def _to_data(
    line: SliderLine, layout: SliderLayout, y: int, column: float, row: float
) -> tuple[float, float]:
    share = (column - 0.5 - layout.track) / max(1, layout.track_width - 1)
    return line.lowest + share * (line.highest - line.lowest), row - y


def _to_cells(
    line: SliderLine, layout: SliderLayout, y: int, x: float, row: float
) -> tuple[float, float]:
    return layout.track + 0.5 + line.share(x) * max(1, layout.track_width - 1), y + row
