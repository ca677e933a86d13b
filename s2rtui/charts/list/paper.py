"""The list on paper: the rows and columns that fit, and the number of those that do not."""

from __future__ import annotations

from typing import TYPE_CHECKING

from s2rtui.canvas import LIGHT, Rgb, Theme
from s2rtui.charts.list.model import ListColumn, ListInput
from s2rtui.charts.shared.paper import (
    Page,
    Pixels,
    draw_heading,
    figure_bytes,
    make_page,
    new_figure,
    rgb_fractions,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROW, LETTER, GAP, LEFT, FOOT = 0.215, 0.078, 0.22, 0.3, 0.45
"""Inches: a row's height, a letter's width, between columns, at the left, at the foot."""


def list_figure(
    data: ListInput,
    size: Pixels = (1600, 1200),
    theme: Theme = LIGHT,
    title: str = "List",
    subtitle: str = "",
) -> bytes:
    """Draw the first rows in `size` pixels, with the cursor's row highlighted."""
    page = make_page(size, theme)
    figure = new_figure(page)
    top = draw_heading(figure, page, title, subtitle) - 0.1
    count = max(1, min(len(data.rows), int((top - FOOT) / ROW) - 1))
    rows = data.rows[:count].tolist()
    columns = _columns(data, rows, page)
    _line(figure, page, top - ROW + 0.02, theme.muted, 0.9)
    for column, start, end in columns:
        ink = theme.text if column.sorts else theme.muted
        name = column.title + (" ▼" if data.descending else " ▲") * column.sorts
        _put(figure, page, (column, start, end), top - ROW / 2, name, ink, column.sorts)
    for index, iid in enumerate(rows):
        y = top - ROW * (index + 1.5)
        if iid == data.cursor:
            _ground(figure, page, y)
        for column, start, end in columns:
            _put(figure, page, (column, start, end), y, column.text(iid), theme.text, False)
    _note(figure, page, _left_out(len(data.rows) - len(rows), len(data.columns) - len(columns)))
    return figure_bytes(figure, page)


def _columns(data: ListInput, rows: list[int], page: Page) -> list[tuple[ListColumn, float, float]]:
    """The columns that fit, with their left and right ends in inches."""
    columns: list[tuple[ListColumn, float, float]] = []
    x = LEFT
    for column in data.columns:
        texts = [len(column.text(iid)) for iid in rows]
        letters = max([len(column.title) + 2 * column.sorts, *texts])
        end = x + LETTER * min(letters, 3 * column.width)
        if columns and end > page.inches[0] - 0.15:
            break
        columns.append((column, x, end))
        x = end + GAP
    return columns


def _left_out(rows: int, columns: int) -> str:
    parts = [f"{n} more {what}" for n, what in ((rows, "rows"), (columns, "columns")) if n > 0]
    return " and ".join(parts)


def _put(
    figure: Figure,
    page: Page,
    place: tuple[ListColumn, float, float],
    y: float,
    text: str,
    ink: Rgb,
    bold: bool,
) -> None:
    column, start, end = place
    most = int((end - start) / LETTER + 0.5)
    text = text if len(text) <= most else text[: most - 1] + "…"
    wide, high = page.inches
    x = end if column.right else start
    label = figure.text(x / wide, y / high, text, va="center", fontsize=9)
    label.set_horizontalalignment("right" if column.right else "left")
    label.set_color(rgb_fractions(ink))
    label.set_fontweight("bold" if bold else "normal")


def _line(figure: Figure, page: Page, y: float, ink: Rgb, width: float) -> None:
    from matplotlib.lines import Line2D

    wide, high = page.inches
    ends = [0.2 / wide, 1 - 0.2 / wide]
    figure.add_artist(Line2D(ends, [y / high, y / high], color=rgb_fractions(ink), linewidth=width))


def _ground(figure: Figure, page: Page, y: float) -> None:
    from matplotlib.patches import Rectangle

    wide, high = page.inches
    corner = (0.2 / wide, (y - ROW / 2) / high)
    ground = Rectangle(corner, 1 - 0.4 / wide, ROW / high, linewidth=0, zorder=-1)
    ground.set_color(rgb_fractions(page.theme.highlight))
    figure.add_artist(ground)


def _note(figure: Figure, page: Page, text: str) -> None:
    wide, high = page.inches
    label = figure.text(LEFT / wide, 0.2 / high, text, va="center", fontsize=8)
    label.set_color(rgb_fractions(page.theme.muted))
