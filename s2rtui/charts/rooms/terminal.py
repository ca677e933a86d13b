"""The rooms in cells: a row per room, bars for sim, truth and real."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from rich.cells import cell_len

from s2rtui.canvas import DEFAULT_OPTIONS, Canvas, Mark, Panel, Point, RenderOptions, Rgb, Size
from s2rtui.canvas.fit_text import fit_text
from s2rtui.canvas.marks import mark_on_panel, mark_rows
from s2rtui.charts.rooms.model import NAMES, RoomsInput, RoomsModel, rooms_model
from s2rtui.charts.shared.bars import draw_horizontal_bars, put_over_bar

WIDEST = 18
"""Most columns of a room's name."""
SHORTEST = 5
"""Fewest columns of a bar that has counts beside it."""
THICKEST = 3
"""Most rows per room, the gap below its bar included."""


@dataclass(frozen=True, slots=True)
class RoomsLayout:
    """The layout in cells.

    name: width of the names. columns: (x, width) of up to three columns: `gutter`, bar, and
    `numbers` cells for counts (with totals if `whole`). top: the row of the first room; each:
    rows per room; first, shown: the visible rooms.
    """

    name: int
    columns: tuple[tuple[int, int], ...]
    gutter: int
    numbers: int
    whole: bool
    top: int
    each: int
    first: int
    shown: int

    @property
    def bar(self) -> int:
        """Width of the longest bar."""
        return max(1, self.columns[0][1] - self.gutter - self.numbers)


def rooms_layout(data: RoomsInput, size: Size, model: RoomsModel | None = None) -> RoomsLayout:
    """Lay out the parts; the window follows the brush mark, scrolling, or the true room."""
    model = model or rooms_model(data)
    width, height = max(1, size[0]), max(1, size[1])
    longest = max((cell_len(name) for name in model.names), default=0)
    name = min(longest, WIDEST, width // 4) if width >= 16 else 0
    free = width - name - (1 if name else 0)
    each_wide = (free - 2) // 3 if free >= 5 else max(1, free // 3)
    number = 3 if free >= 3 else 1
    start, step = width - free, each_wide + (1 if free >= 5 else 0)
    columns = tuple((start + index * step, each_wide) for index in range(number))
    gutter = 2 if each_wide >= 18 else 1 if each_wide >= 4 else 0
    both = max(map(len, _numbers(model, True)), default=0) + 1
    alone = max(map(len, _numbers(model, False)), default=0) + 1
    room = each_wide - gutter - SHORTEST
    whole = both <= room
    numbers = both if whole else alone if alone <= room else 0
    top = 1 if height >= 3 else 0
    rows = max(1, height - top)
    count = len(model.names)
    each = min(THICKEST, max(1, rows // max(1, count)))
    shown = min(count, rows // each)
    first = min(max(0, _first(data, model, shown)), count - shown)
    return RoomsLayout(name, columns, gutter, numbers, whole, top, each, first, shown)


def _first(data: RoomsInput, model: RoomsModel, shown: int) -> int:
    """The wanted first row of `shown` ones."""
    if data.mark is not None and data.mark.points:
        return round(data.mark.points[-1][1]) - shown // 2
    return (model.cursor[1] or 0) - shown // 2 if data.first is None else data.first


def _numbers(model: RoomsModel, whole: bool) -> list[str]:
    pairs = zip(model.highlighted.ravel().tolist(), model.total.ravel().tolist(), strict=True)
    return [_number(highlighted, total, whole) for highlighted, total in pairs]


def _number(highlighted: int, total: int, whole: bool) -> str:
    return f"{_brief(highlighted)}/{_brief(total)}" if whole else _brief(highlighted)


def _brief(count: int) -> str:
    """At most five characters."""
    return str(count) if count < 100_000 else f"{count // 1000}k"


def rooms_panels(
    data: RoomsInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> tuple[Panel, ...]:
    """Panels "sim", "truth" and "real": y is the index of a room, x a count.

    The index len(room_names) stands for no room.
    """
    model = rooms_model(data)
    layout = rooms_layout(data, size, model)
    if not layout.shown:
        return ()
    per_cell = model.peak / layout.bar
    return tuple(
        Panel(
            name,
            "steps",
            x,
            layout.top,
            width,
            layout.shown * layout.each,
            partial(_to_data, layout, x + layout.gutter, per_cell),
            partial(_to_cells, layout, x + layout.gutter, per_cell),
        )
        for name, (x, width) in zip(NAMES, layout.columns, strict=False)
    )


def _to_data(layout: RoomsLayout, left: int, per_cell: float, column: float, row: float) -> Point:
    index = int(np.floor((row - layout.top) / layout.each))
    held = min(max(index, 0), layout.shown - 1)
    return (column - left) * per_cell, float(layout.first + held)


def _to_cells(layout: RoomsLayout, left: int, per_cell: float, x: float, y: float) -> Point:
    row = layout.top + (round(y) - layout.first) * layout.each
    return left + x / per_cell, row + max(1, layout.each - 1) / 2


def draw_rooms(data: RoomsInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS) -> Canvas:
    """The view in `size` (columns, rows)."""
    canvas = Canvas(*size, options)
    model = rooms_model(data)
    if not model.names:
        canvas.text(0, 0, "no rooms", options.theme.muted)
        return canvas
    layout = rooms_layout(data, (canvas.width, canvas.height), model)
    _names(canvas, model, layout)
    panels = rooms_panels(data, (canvas.width, canvas.height), options)
    for index, panel in enumerate(panels):
        mark, colour = mark_on_panel(data.mark, panel.name), getattr(options.theme, panel.name)
        _column(canvas, panel, index, model, layout, mark, colour)
    return canvas


def _names(canvas: Canvas, model: RoomsModel, layout: RoomsLayout) -> None:
    theme, glyphs = canvas.theme, canvas.glyphs
    if layout.top:
        for (x, width), name in zip(layout.columns, NAMES, strict=False):
            glyph, colour = canvas.options.role(name)
            text = f"{glyph} {name}"
            fits = len(text) <= width - layout.gutter
            canvas.text(x + layout.gutter, 0, text if fits else glyph, colour)
        if layout.shown < len(model.names):
            last = layout.first + layout.shown
            window, count = f"{layout.first + 1}-{last}", len(model.names)
            texts = (f"{window} of {count}", f"{window}/{count}", window)
            shown_window = next((text for text in texts if len(text) <= layout.name), "")
            canvas.text(0, 0, shown_window, theme.muted)
    if not layout.name:
        return
    for place in range(layout.shown):
        index = layout.first + place
        name = model.names[index]
        name = fit_text(name, layout.name, glyphs.ellipsis)
        is_cursor = index == model.cursor[1]
        row = layout.top + place * layout.each + (layout.each - 1) // 2
        ink = theme.text if is_cursor else theme.muted
        canvas.text(0, row, canvas.options.printable(name), ink, bold=is_cursor)


def _column(
    canvas: Canvas,
    panel: Panel,
    index: int,
    model: RoomsModel,
    layout: RoomsLayout,
    mark: Mark | None,
    colour: Rgb,
) -> None:
    """Bars with counts; brush mark and cursor in the gutter."""
    theme, each = canvas.theme, layout.each
    thick = max(1, each - 1)
    low, high = (-1, -2) if mark is None else mark_rows(mark)
    shown = slice(layout.first, layout.first + layout.shown)
    for room in range(max(low, shown.start), min(high + 1, shown.stop)):
        row = panel.y + (room - layout.first) * each
        canvas.fill(panel.x, row, panel.width, thick, theme.highlight)
    inked = np.arange(layout.shown * each) % each < thick
    highlighted, grey = (
        np.where(inked, np.repeat(part[index, shown] / model.peak, each), 0.0)
        for part in (model.highlighted, model.total)
    )
    draw_horizontal_bars(
        canvas, panel.x + layout.gutter, panel.y, layout.bar, (highlighted, grey), colour
    )
    for room in range(shown.start, shown.stop):
        middle = panel.y + (room - layout.first) * each + (thick - 1) // 2
        held = low <= room <= high
        if layout.numbers:
            selected, whole = int(model.highlighted[index, room]), int(model.total[index, room])
            text = _number(selected, whole, layout.whole)
            ink, end = theme.text if selected else theme.muted, panel.x + panel.width
            canvas.text(end, middle, text, ink, bold=held, align="right")
        if held:
            canvas.put(panel.x, middle, canvas.glyphs.pointer, theme.truth, bold=True)
        if room == model.cursor[index]:
            beside = held and layout.gutter == 1
            at = panel.x + (1 if beside else max(0, layout.gutter - 1))
            put_over_bar(canvas, at, middle, canvas.glyphs.cursor, theme.cursor)
