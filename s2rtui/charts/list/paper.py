"""The list on paper: the rows and columns that fit, and the number of those that do not."""

from __future__ import annotations

from s2rtui.canvas import LIGHT, Theme
from s2rtui.canvas.fit_text import fit_text
from s2rtui.charts.list.model import ListColumn, ListInput
from s2rtui.drawing.page import Ink, Page, Pixels, new_page, own_settings

ROW, LETTER, GAP, LEFT, FOOT = 0.215, 0.078, 0.22, 0.3, 0.45
"""Inches: a row's height, a letter's width, between columns, at the left, at the foot."""


@own_settings()
def list_figure(
    data: ListInput, size: Pixels, theme: Theme = LIGHT, title: str = "", subtitle: str = ""
) -> bytes:
    """Draw the first rows in `size` pixels, with the cursor's row highlighted."""
    page = new_page(size, theme, title, subtitle)
    inks, top = page.inks, page.top - 0.1
    count = max(1, min(len(data.rows), int((top - FOOT) / ROW) - 1))
    rows = data.rows[:count].tolist()
    columns = _columns(data, rows, page)
    _draw_rule(page, top - ROW + 0.02)
    for column, start, end in columns:
        ink = inks.text if column.sorts else inks.muted
        name = column.title + (" ▼" if data.descending else " ▲") * column.sorts
        _put(page, (column, start, end), top - ROW / 2, name, ink, column.sorts)
    for index, iid in enumerate(rows):
        y = top - ROW * (index + 1.5)
        if iid == data.cursor:
            _highlight_row(page, y)
        for column, start, end in columns:
            _put(page, (column, start, end), y, column.text(iid), inks.text, False)
    missing = ((len(data.rows) - len(rows), "rows"), (len(data.columns) - len(columns), "columns"))
    note = " and ".join(f"{number} more {what}" for number, what in missing if number > 0)
    page.text(LEFT, 0.2, note, inks.muted, 8, va="center")
    return page.encoded()


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


def _put(
    page: Page, place: tuple[ListColumn, float, float], y: float, text: str, ink: Ink, bold: bool
) -> None:
    column, start, end = place
    most = int((end - start) / LETTER + 0.5)
    text = fit_text(text, most, "…")
    x, side = (end, "right") if column.right else (start, "left")
    weight = "bold" if bold else "normal"
    page.text(x, y, text, ink, 9, va="center", ha=side, fontweight=weight)


def _draw_rule(page: Page, y: float) -> None:
    from matplotlib.lines import Line2D

    wide, high = page.inches
    ends, ink = [0.2 / wide, 1 - 0.2 / wide], page.inks.muted
    page.figure.add_artist(Line2D(ends, [y / high, y / high], color=ink, linewidth=0.9))


def _highlight_row(page: Page, y: float) -> None:
    from matplotlib.patches import Rectangle

    wide, high = page.inches
    corner, ink = (0.2 / wide, (y - ROW / 2) / high), page.inks.highlight
    ground = Rectangle(corner, 1 - 0.4 / wide, ROW / high, linewidth=0, zorder=-1, color=ink)
    page.figure.add_artist(ground)
