"""Draw a table on a page: texts in columns, strips on axes of matplotlib, lines between rows."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from s2rstore.errors import counted
from s2rstore.security.printable_text import printable
from s2rtui.canvas.colour import luminance
from s2rtui.canvas.fit_text import NO_BREAK, fit_text
from s2rtui.canvas.render_options import UNICODE
from s2rtui.drawing.heat_colours import ramp_colours
from s2rtui.drawing.page import BOLD, LETTER, Ink, Page, style_axes, wrapped_text
from s2rtui.drawing.plot import ROLES
from s2rtui.drawing.plot_paper import axis_name, marker_style, set_ticks
from s2rtui.drawing.row_lines import LineLayer, RowLines
from s2rtui.drawing.scale import Scale
from s2rtui.drawing.table import Bar, Row, Span, StripMark, TableSpec, Text
from s2rtui.drawing.table_layout import ALL_LINES, TableLayout, table_layout

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LINE = 0.17
"""Height of a line of a table and of notes in inches."""
_AXIS = 0.42
"""Height of the axis of strips in inches."""
_STEP, _STEP_WITH_LINES = 1.6, 2.8
"""Lines from a row with strips to the next one, and with lines from strip to strip."""
_DARK = 0.2
"""Luminance of a ground below which texts on it are white."""
_BAR = 0.7
"""Height of a bar as a share of its row."""
_BINS = 500
"""Bins of a scale for bands."""
_BANDS = ((0, 4, 0.16), (1, 3, 0.26))
"""The quantiles at the ends of each band, and its opacity."""


def sentences(table: TableSpec, letters: int) -> list[str]:
    """The rows as sentences, where no column may be left out and they do not fit; else none."""
    if any(column.rank or column.scale or column.wraps for column in table.columns):
        return []
    layout = page_layout(table, letters, len(table.rows) + 1)
    needed = max((start + width for start, width in zip(layout.starts, layout.widths, strict=True)),
                 default=0)  # fmt: skip
    if layout.is_detailed and needed <= letters:
        return []
    return [line for text in table.sentences(NO_BREAK) for line in wrapped(text, letters)]


def page_layout(table: TableSpec, letters: int, lines: int = ALL_LINES) -> TableLayout:
    """The layout of a table on a page, which counts its hidden rows below it.

    Strips are left out last, and texts in bold letters have room.
    """
    columns = tuple(
        column if column.scale is None else replace(column, rank=min(column.rank, 1))
        for column in table.columns
    )
    if any(column.wraps for column in columns) and any(row.bold for row in table.rows):
        letters = int(letters / BOLD)
    return table_layout(replace(table, columns=columns), letters, lines, has_window=False)


def wrapped(text: str, letters: int) -> list[str]:
    """Wrap a text into lines no wider than `letters` letters of average width."""
    return wrapped_text(text, max(20, letters) * LETTER, 1.0)


def draw_table(
    page: Page, table: TableSpec, top: float, bottom: float, font: float, margin: float,
    width: float,
) -> None:  # fmt: skip
    """Draw what fits between two heights of the page in `width` inches, `margin` at its left."""
    height = line_height(font)
    letter = LETTER * font
    letters = int(width / letter)
    has_axis = page_layout(table, letters).axis is not None
    is_cut = _hidden_columns(table, page_layout(table, letters)) > 0
    room = top - bottom - _AXIS * has_axis - LINE * is_cut
    lines = max(1, int(room / height + 1e-6))
    if not _has_notes(table) and any(column.scale is not None for column in table.columns):
        lines = min(lines, len(table.rows) + table.has_head)
    layout = page_layout(table, letters, lines + has_axis)
    if layout.shown < len(table.rows) and not is_cut:  # a line says how many rows are hidden
        room -= LINE
        layout = page_layout(table, letters, max(1, min(lines, int(room / height))) + has_axis)
    used = layout.top + len(layout.lines)
    is_spread = _has_strips(table, layout) and not _has_notes(table)
    step = room / max(1, used) if is_spread else height
    if table.lines is None:
        step = min(step, 2.2 * height)
    heights = [top - (at + 0.5) * step for at in range(used)]
    shown = list(zip(layout.columns, layout.starts, layout.widths, layout.text_widths, strict=True))
    for place, start, wide, texts in shown:
        column = table.columns[place]
        left, right = margin + start * letter, margin + (start + wide) * letter
        if column.scale is not None:
            first = top - layout.top * step
            inches = (right - left - (texts + 1) * letter, first - (heights[-1] - step / 2))
            axes = page.axes(left, heights[-1] - step / 2, *inches)
            _draw_strips(axes, page, table, layout, place, inches)
        if layout.top:
            name = column.name + ("▼" if table.descending else "▲") * column.sorts
            ink = page.inks.text if column.sorts else getattr(page.inks, column.ink)
            x, side = (right, "right") if column.right else (left, "left")
            weight = "bold" if column.sorts or column.ink in ROLES else "normal"
            page.text(x, heights[0], name, ink, font, ha=side, va="center", fontweight=weight)
    for y, line in zip(heights[layout.top :], layout.lines, strict=True):
        row = table.rows[line.row]
        if (line.row == table.chosen and table.column is None) or row.marked:
            _highlight(page, y, step)
        for place, start, wide, texts in shown:
            column = table.columns[place]
            left, right = margin + start * letter, margin + (start + wide) * letter
            room = wide if column.scale is None else texts
            text, ink = _text(table, layout, row, place, line.part, line.text, room)
            if row.sign and place == 0 and line.part == 0:
                text = f"{getattr(UNICODE, row.sign)} {text}"
            if line.is_note:
                ink = "muted"
            if not text:
                continue
            on_ground: Ink | None = None
            if (heat := row.cells[place].heat) is not None and line.part == 0:
                ground = ramp_colours("values")(heat)
                ends = left - letter, right + letter / 2
                _fill(page, ends, (y, 0.92 * step), tuple(ground / 255))
                on_ground = (1.0,) * 3 if luminance(ground) < _DARK else (0.0,) * 3
            at_right = column.right or column.scale is not None
            x, side = (right, "right") if at_right else (left, "left")
            most = wide if column.scale is None else max(wide, len(text))
            if line.is_note and not column.wraps:
                most = letters
            weight = "bold" if row.bold and not line.is_note else "normal"
            text = fit_text(printable(text), most + 1, "…")
            colour = on_ground or getattr(page.inks, ink)
            page.text(x, y, text, colour, font, ha=side, va="center", fontweight=weight)
    hidden = {"row": len(table.rows) - layout.shown, "column": _hidden_columns(table, layout)}
    more = " and ".join(counted(count, f"more {what}") for what, count in hidden.items() if count)
    if more:
        page.text(margin, bottom + 0.03, more, page.inks.muted, 8)


def line_height(font: float) -> float:
    """The height of a line in inches."""
    return LINE * font / 9


def table_inches(table: TableSpec, letters: int, font: float) -> float:
    """The height of a table in inches, with a line for each row, and its wrapped texts."""
    layout = page_layout(table, letters)
    has_axis, is_cut = layout.axis is not None, _hidden_columns(table, layout) > 0
    around = _AXIS * has_axis + LINE * is_cut
    if _has_strips(table, layout) and not _has_notes(table):
        lines = (_STEP_WITH_LINES if table.lines else _STEP) * (layout.top + len(table.rows))
        return lines * line_height(font) + around
    return (layout.top + len(layout.lines)) * line_height(font) + around


def _hidden_columns(table: TableSpec, layout: TableLayout) -> int:
    """Columns that are left out; the name of a row that stands before its text is not."""
    wraps = any(table.columns[place].wraps for place in layout.columns)
    return 0 if wraps else len(table.columns) - len(layout.columns)


def _has_notes(table: TableSpec) -> bool:
    return any(row.notes for row in table.rows[:1])


def _has_strips(table: TableSpec, layout: TableLayout) -> bool:
    return any(table.columns[place].scale is not None for place in layout.columns)


def _text(
    table: TableSpec, layout: TableLayout, row: Row, place: int, part: int, text: str, room: int
) -> tuple[str, str]:
    """The text of a cell in a line, and its ink."""
    column, cell = table.columns[place], row.cells[place]
    ink = row.inks.get(place, row.ink)
    wraps = any(table.columns[each].wraps for each in layout.columns)
    if column.wraps or (part and place == layout.columns[0] and not wraps):
        return text, ink
    if part:
        return "", ink
    return cell.in_room(room), ink


def _highlight(page: Page, y: float, height: float) -> None:
    _fill(page, (0.2, page.inches[0] - 0.2), (y, height), page.inks.highlight)


def _fill(page: Page, ends: tuple[float, float], at: tuple[float, float], colour: Any) -> None:
    """A rectangle from left to right around a height, which has a height; inches."""
    from matplotlib.patches import Rectangle

    (left, right), (y, height), (wide, high) = ends, at, page.inches
    corner = (left / wide, (y - height / 2) / high)
    ground = Rectangle(corner, (right - left) / wide, height / high, linewidth=0, zorder=-1,
                       color=colour)  # fmt: skip
    page.figure.add_artist(ground)


def _draw_strips(
    axes: Axes, page: Page, table: TableSpec, layout: TableLayout, place: int,
    inches: tuple[float, float],
) -> None:  # fmt: skip
    """The strips of a column; row k of the lines is at y = k."""
    scale = table.columns[place].scale
    assert scale is not None
    style_axes(axes, page)
    axes.patch.set_visible(False)
    count = len(layout.lines)
    axes.set_xlim(scale.low, scale.high)
    axes.set_ylim(max(count, 1) - 0.5, -0.5)
    axes.set_yticks([])
    if scale.names:
        set_ticks(axes, page, scale, inches[0])
        axes.set_xlabel(axis_name(scale, inches[0]))
        axes.grid(axis="x", color=page.inks.faint, linewidth=0.6)
        axes.set_axisbelow(True)
    else:
        axes.set_xticks([])
        for spine in axes.spines.values():
            spine.set_visible(False)
    if table.lines is not None:
        first = layout.first
        shown = replace(table.lines, values=table.lines.values[first : first + layout.shown])
        draw_row_lines(axes, page, shown, scale)
    for rule in table.columns[place].rules:
        axes.axvline(rule.at, color=getattr(page.inks, rule.ink), linewidth=1.4,
                     linestyle=(0, (2, 2)) if rule.dashed else "-", zorder=2)  # fmt: skip
    for y, line in enumerate(layout.lines):
        for mark in table.rows[line.row].cells[place].strip if line.part == 0 else ():
            _draw_strip_mark(axes, page, mark, y)


def _draw_strip_mark(axes: Axes, page: Page, mark: StripMark, y: float) -> None:
    ink = getattr(page.inks, mark.ink)
    if isinstance(mark, Bar):
        axes.barh(y, mark.whole, height=_BAR, color=page.inks.faint, linewidth=0, zorder=2)
        axes.barh(y, mark.value, height=_BAR, color=ink, linewidth=0, zorder=3)
    elif isinstance(mark, Span):
        if math.isfinite(mark.low) and math.isfinite(mark.high):
            width, order, opacity = (5.0, 3, 0.35) if mark.is_thick else (1.6, 4, 1.0)
            axes.plot([mark.low, mark.high], [y, y], color=ink, linewidth=width, alpha=opacity,
                      zorder=order, solid_capstyle="butt")  # fmt: skip
            left, right = axes.get_xlim()
            for end, sign, is_beyond in (
                (left, "<", mark.low < left),
                (right, ">", mark.high > right),
            ):
                if is_beyond:
                    axes.plot(
                        [end], [y], sign, color=ink, markersize=5, clip_on=False, zorder=order
                    )
    elif isinstance(mark, Text):
        axes.annotate(mark.text, (0, y), xycoords=("axes fraction", "data"), va="center",
                      fontsize=8, color=ink, path_effects=page.halo(2), zorder=5)  # fmt: skip
    else:
        low, high = axes.get_xlim()
        axes.plot([min(max(mark.at, low), high)], [y], zorder=5, clip_on=False,
                  **marker_style(page, mark.sign, ink))  # fmt: skip


def draw_row_lines(axes: Axes, page: Page, lines: RowLines, scale: Scale) -> None:
    """Draw the lines of all rows, row k at y = k, that of the cursor on top."""
    for order, layer in enumerate(lines.layers):
        ink: Ink = getattr(page.inks, layer.ink)
        if layer.is_pale:
            red, green, blue = np.mean([ink, page.inks.background], axis=0).tolist()
            ink = red, green, blue
        draw = _draw_bands if layer.is_banded else _draw_lines
        draw(axes, layer, scale, ink, 3.5 if layer.ink == "cursor" else 1 + 0.2 * order)


def _draw_bands(axes: Axes, layer: LineLayer, scale: Scale, ink: Ink, order: float) -> None:
    places = scale.value(layer.quantiles(scale, _BINS))
    rows = np.arange(len(places))
    for left, right, opacity in _BANDS:
        axes.fill_betweenx(rows, places[:, left], places[:, right], color=ink, alpha=opacity,
                           linewidth=0, zorder=order)  # fmt: skip
    axes.plot(places[:, 2], rows, color=ink, linewidth=1.1, alpha=0.8, zorder=order + 0.1)


def _draw_lines(axes: Axes, layer: LineLayer, scale: Scale, ink: Ink, order: float) -> None:
    """A line per instance, interrupted where it has no value."""
    places = scale.value(layer.shares(scale))
    is_cursor = layer.ink == "cursor"
    opacity = 1.0 if is_cursor else 0.45 if layer.ink == "unselected" else 0.75
    axes.plot(places, np.arange(len(places)), color=ink, linewidth=1.4 if is_cursor else 0.7,
              alpha=opacity, zorder=order)  # fmt: skip
