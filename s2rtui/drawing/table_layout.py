"""Where the parts of a table are, in cells of the terminal or in letters of a page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from rich.cells import cell_len

from s2rtui.canvas.fit_text import wrap_text
from s2rtui.drawing.plot import ROLES
from s2rtui.drawing.scale import Scale
from s2rtui.drawing.table import Bar, Column, Row, TableSpec

ALL_LINES = 10_000
"""A height in which every table fits."""
GAP = 2
"""Blank columns between the columns of a table; in cells one before columns are left out."""
_GUTTER = 2
"""Columns before the rows of a table that has a panel, for the pointer and the cursor."""
_SHORTEST_NAME, _SHORTEST_STRIP, _NARROWEST_TEXT = 16, 12, 42
_NARROW = 64
"""Columns below which the name of a row stands before its wrapped text."""
_FEWEST_WITH_AXIS = 8
"""Lines below the head from which on strips have an axis."""
_MEASURED = 500
"""Rows of a longer table are measured where they are visible."""
_THICKEST = 3
"""Most lines of a row with strips, the blank one below it included."""
_FARTHEST = 12
"""Most lines from a row to the next one where instances are lines between them."""


@dataclass(frozen=True, slots=True)
class TableLine:
    """A line of a row: its first one, where `part` is 0, or a further one with a text.

    is_cut: whether it is the last one that has room, and texts go on.
    """

    row: int
    part: int = 0
    text: str = ""
    is_note: bool = False
    is_cut: bool = False


@dataclass(frozen=True, slots=True)
class TableLayout:
    """The visible columns and lines of a table, all in cells from its upper left corner.

    columns: places of the visible columns; starts, widths: of each. text_widths: of the texts
    behind strips. top: line of the first row; each: lines from a row with strips to the next one.
    first, shown: the visible rows. axis: line of the axis of strips, if any. is_detailed: whether
    all details have room. is_tight: whether names are cut, or strips shorter than they should be.
    """

    columns: tuple[int, ...]
    starts: tuple[int, ...]
    widths: tuple[int, ...]
    text_widths: tuple[int, ...]
    gutter: int
    top: int
    lines: tuple[TableLine, ...]
    each: int
    first: int
    shown: int
    axis: int | None
    is_detailed: bool
    is_tight: bool

    @property
    def end(self) -> int:
        """The line after the last one."""
        return self.top + len(self.lines) + (self.axis is not None)

    def strips(self, table: TableSpec) -> Iterator[tuple[int, Scale, int, int]]:
        """Yield place, scale, start and length of each visible column of strips."""
        widths = zip(self.columns, self.starts, self.widths, self.text_widths, strict=True)
        for place, start, width, texts in widths:
            if (scale := table.columns[place].scale) is not None:
                yield place, scale, start, width - (texts + 1 if texts else 0)


def wanted_lines(table: TableSpec) -> int:
    """Lines of a table whose rows have one line each, with its head and axis."""
    has_axis = any(column.scale is not None and column.scale.names for column in table.columns)
    return len(table.rows) + table.has_head + has_axis


def table_layout(
    table: TableSpec, width: int, height: int = ALL_LINES, has_window: bool = True
) -> TableLayout:
    """Lay out a table in `width` x `height` cells; columns that do not fit are left out.

    Details, then columns of the largest rank, are left out first. Rows are spread where they have
    bars or lines between them, and there is room. has_window: whether the head counts the visible
    rows where not all are, and a pointer can stand before the rows.
    """
    gutter = _GUTTER if has_window and (table.panel or table.chosen is not None) else 0
    top = int(table.has_head and height > 1)
    has_axis = any(column.scale is not None and column.scale.names for column in table.columns)
    free = max(1, height - top)
    count = len(table.rows)
    axis = int(has_axis and free >= min(_FEWEST_WITH_AXIS, count + 1))
    room = max(1, free - axis)
    first = _first_row(table, min(count, room))
    measured = table.rows[first : first + room] if count > _MEASURED else list(table.rows)
    room_across = max(1, width - gutter)
    window = len(f"{count}-{count}/{count}") if has_window and top and count > room else 0
    gaps = (GAP, 1) if has_window else (GAP,)
    columns, widths, texts, is_detailed, choice = _columns(
        table, measured, room_across, window, gaps
    )
    if axis and not any(
        scale is not None and scale.names for scale in (table.columns[at].scale for at in columns)
    ):
        axis, room = 0, free
        first = _first_row(table, min(count, room))
    wrapping = [place for place, column in enumerate(table.columns) if column.wraps]
    if wrapping and width < _NARROW:
        columns, widths, texts = wrapping[:1], [room_across], [0]
    if any(row.notes for row in measured) or any(column.wraps for column in table.columns):
        lines = _entries(table, columns, widths, room_across, room)
        start = _first_line(table, lines, room)
        is_cut = len(lines) > start + room
        lines = lines[start : start + room]
        if is_cut:
            lines[-1] = replace(lines[-1], is_cut=True)
        each = 1
    else:
        has_bars = any(
            isinstance(mark, Bar) for row in measured for place in columns
            for mark in row.cells[place].strip
        )  # fmt: skip
        each = min(_THICKEST, max(1, room // max(1, count))) if has_bars else 1
        if table.lines is not None:
            each = min(_FARTHEST, max(1, (room - 1) // (count - 1))) if count > 1 else 1
        shown = range(first, min(count, first + -(-room // each)))
        lines = [TableLine(row, part) for row in shown for part in range(each)]
        if each > 1:
            lines = lines[: 1 - each if table.lines else -1]
    rows = sorted({line.row for line in lines})
    starts, x = [], gutter
    for taken in widths:
        starts.append(x)
        x += taken + choice.gap
    return TableLayout(
        tuple(columns), tuple(starts), tuple(widths), tuple(texts), gutter, top, tuple(lines), each,
        rows[0] if rows else 0, len(rows), top + len(lines) if axis else None, is_detailed,
        choice.strip < _SHORTEST_STRIP,
    )  # fmt: skip


def _first_row(table: TableSpec, shown: int) -> int:
    """The first of `shown` visible rows; the brush, the chosen or the marked row is among them."""
    first = 0
    if table.brushed is not None:
        first = table.brushed[1] - shown // 2
    elif table.chosen is not None:
        first = table.chosen - shown // 2
    elif len(table.rows) <= _MEASURED:
        marked = next((place for place, row in enumerate(table.rows) if row.marked), 0)
        first = marked - shown // 2 if marked >= shown else 0
    return min(max(0, first), max(0, len(table.rows) - shown))


@dataclass(frozen=True, slots=True)
class _Choice:
    """What is shown: columns up to a rank, blanks between them, texts behind strips; and the least
    widths.
    """

    rank: int
    gap: int = GAP
    strip_texts: bool = True
    name: int = _SHORTEST_NAME
    strip: int = _SHORTEST_STRIP


def _columns(
    table: TableSpec, rows: Sequence[Row], width: int, window: int, gaps: tuple[int, ...]
) -> tuple[list[int], list[int], list[int], bool, _Choice]:
    """The visible columns, their widths, the widths of their texts, `is_detailed` and the choice.

    window: letters of the numbers of the visible rows, in the head of the first column.
    """
    ranks = sorted({column.rank for column in table.columns}, reverse=True)
    tight = max(4, width // 4)
    strips = [column.least for column in table.columns if column.scale is not None]
    wide = max([_SHORTEST_STRIP, *strips])
    choices = [
        *(_Choice(rank, gap, strip=wide) for rank in (ranks[:-1] or ranks) for gap in gaps),
        *(_Choice(rank, gap) for rank in ranks for gap in gaps),
        _Choice(ranks[-1], gaps[-1], name=tight, strip=5),
        _Choice(ranks[-1], gaps[-1], strip_texts=False, name=tight, strip=4),
    ]  # fmt: skip
    for choice in choices:
        places = [at for at, column in enumerate(table.columns) if column.rank <= choice.rank]
        texts = [_text_width(table.columns[at], at, rows, choice) for at in places]
        least = [
            max(_least(table.columns[at], at, text, choice), 0 if at else window)
            for at, text in zip(places, texts, strict=True)
        ]
        free = width - sum(least) - choice.gap * (len(places) - 1)
        if free >= 0:
            break
    details = [max((cell_len(row.cells[at].whole) for row in rows), default=0) for at in places]
    widths, is_detailed = _widths(table, places, texts, details, least, free)
    return places, widths, texts, is_detailed, choice


def _text_width(column: Column, place: int, rows: Sequence[Row], choice: _Choice) -> int:
    if column.scale is not None and not choice.strip_texts:
        return 0
    before = 2 if place == 0 and any(row.sign for row in rows) else 0
    return before + max((cell_len(row.cells[place].text) for row in rows), default=0)


def _least(column: Column, place: int, text: int, choice: _Choice) -> int:
    """The least width of a column whose texts have a width."""
    head = cell_len(column.name) + 2 * (column.ink in ROLES) + column.sorts
    if column.wraps:
        return _NARROWEST_TEXT
    if column.scale is not None:
        return choice.strip + (text + 1 if text else 0)
    if place == 0 or column.is_cut:
        shortest = 0 if place else choice.name
        return min(max(head, text, column.least), max(shortest, head, column.least))
    return max(head, text, column.least)


def _widths(
    table: TableSpec, places: list[int], texts: list[int], details: list[int], least: list[int],
    free: int,
) -> tuple[list[int], bool]:  # fmt: skip
    """The widths of columns: names have their whole length, then details as far as there is room,
    for which those of `texts` grow; the rest is for strips and wrapped texts. Also returns whether
    all details have room.
    """
    widths, free = list(least), max(0, free)
    for at, place in enumerate(places):
        if place == 0 or table.columns[place].is_cut:
            more = min(free, max(0, texts[at] - widths[at]))
            widths[at] += more
            free -= more
    wanted = {at: details[at] - max(texts[at], least[at] * (table.columns[place].scale is None))
              for at, place in enumerate(places)
              if texts[at] and not table.columns[place].wraps}  # fmt: skip
    wanted = {at: more for at, more in wanted.items() if more > 0}
    for left, (at, needed) in zip(range(len(wanted), 0, -1), wanted.items(), strict=True):
        more = min(needed, free // left)
        widths[at] += more
        texts[at] += more
        free -= more
        wanted[at] -= more
    wide = [
        at for at, place in enumerate(places)
        if table.columns[place].wraps or table.columns[place].scale is not None
    ]  # fmt: skip
    for number, at in enumerate(wide):
        widths[at] += free // len(wide) + (number < free % len(wide))
    return widths, not any(wanted.values())


def _entries(
    table: TableSpec, columns: list[int], widths: list[int], across: int, room: int
) -> list[TableLine]:  # fmt: skip
    """The lines of rows with wrapped texts and notes.

    As far as there is room with the notes of all rows, else with those of the chosen one, or none.
    """
    everything = frozenset(range(len(table.rows)))
    chosen = frozenset() if table.chosen is None else frozenset({table.chosen})
    lines: list[TableLine] = []
    for noted in (everything, chosen, frozenset[int]()):
        lines = [
            line
            for number, row in enumerate(table.rows)
            for line in _entry(table, number, row, columns, widths, across, number in noted)
        ]
        if len(lines) <= room:
            break
    return lines


def _entry(
    table: TableSpec,
    number: int,
    row: Row,
    columns: list[int],
    widths: list[int],
    across: int,
    noted: bool,
) -> list[TableLine]:
    place = next((at for at, column in enumerate(columns) if table.columns[column].wraps), None)
    room = across if place is None else widths[place]
    text = "" if place is None else row.cells[columns[place]].whole
    if place is not None and 0 not in columns:
        text = f"{row.cells[0].text}: {text}"
    texts = wrap_text(text, room) or [""]
    lines = [TableLine(number, part, text) for part, text in enumerate(texts)]
    for note in row.notes if noted else ():
        for text in wrap_text(note, room):
            lines.append(TableLine(number, len(lines), text, True))
    return lines


def _first_line(table: TableSpec, lines: list[TableLine], room: int) -> int:
    """The first visible line; the chosen row is visible."""
    places = [at for at, line in enumerate(lines) if line.row == table.chosen]
    if len(lines) <= room or not places:
        return 0
    return max(0, min(places[-1] - room + 1, places[0]))
