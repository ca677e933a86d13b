"""A table as data: columns, rows of cells, and strips that show numbers on a scale."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from rich.cells import cell_len

from s2rtui.drawing.plot import Ink, Rule, Sign
from s2rtui.drawing.row_lines import RowLines
from s2rtui.drawing.scale import Scale


@dataclass(frozen=True, slots=True)
class Bar:
    """A bar from zero to `value` before a grey one to `whole`."""

    value: float
    ink: Ink
    whole: float = 0.0


@dataclass(frozen=True, slots=True)
class Span:
    """A line between two values, such as an interval; a thick one is a difference."""

    low: float
    high: float
    ink: Ink
    is_thick: bool = False


@dataclass(frozen=True, slots=True)
class Dot:
    """A sign at a value."""

    at: float
    ink: Ink
    sign: Sign


@dataclass(frozen=True, slots=True)
class Text:
    """A text in place of marks."""

    text: str
    ink: Ink = "muted"


StripMark = Bar | Span | Dot | Text


@dataclass(frozen=True, slots=True)
class Cell:
    """A text, a detail behind it that is left out where there is no room, and a strip before it.

    strip: marks on the scale of the column, the first below the others. heat: share 0 .. 1 of a
    scale of colours, the ground of the cell.
    """

    text: str = ""
    detail: str = ""
    strip: tuple[StripMark, ...] = ()
    heat: float | None = None

    @property
    def whole(self) -> str:
        return f"{self.text} ({self.detail})" if self.detail else self.text

    def in_room(self, room: int) -> str:
        """The text, with its detail where that fits into `room` cells."""
        return self.whole if cell_len(self.whole) <= room else self.text


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table; with an ink of `ROLES` its glyph stands before the name.

    right: whether texts end at the right. scale: of the strips of its cells; an axis is drawn
    where the scale has a name. rules: lines across all its strips. sorts: whether the rows are
    sorted by it. rank: columns of the largest are left out first where there is no room. least:
    its least width in cells; a strip has it as long as columns of more than one rank can be left
    out. wraps: whether its texts are wrapped into the room that the other columns leave. is_cut:
    whether its texts may be cut to its least width, as those of the first column always. panel:
    name of the panel in which its cells can be brushed.
    """

    name: str
    ink: Ink = "muted"
    right: bool = False
    scale: Scale | None = None
    rules: tuple[Rule, ...] = ()
    sorts: bool = False
    rank: int = 0
    least: int = 0
    wraps: bool = False
    is_cut: bool = False
    panel: str = ""


@dataclass(frozen=True, slots=True)
class Row:
    """Cells, the first one its name. notes: texts below it, shown where there is room.

    inks: those of the texts of single columns, by their place. marked: with the cursor's glyph.
    name: of the panel in which its strips take a range of their scale. sign: before the first cell.
    """

    cells: tuple[Cell, ...]
    ink: Ink = "text"
    bold: bool = False
    notes: tuple[str, ...] = ()
    inks: dict[int, Ink] = field(default_factory=dict)
    marked: bool = False
    name: str = ""
    sign: Sign | None = None


@dataclass(frozen=True, slots=True)
class TableSpec:
    """Rows of cells below columns.

    panel: name of the panel in which rows can be chosen. chosen: the highlighted row. column:
    the place of the column of which its cell alone is highlighted. brushed:
    first and last row of a brush. The chosen, brushed or marked row is visible. descending: the
    order of the column that sorts. lines: instances as lines from strip to strip, for which rows
    are set apart where all of them are visible.
    """

    columns: tuple[Column, ...]
    rows: Sequence[Row]
    panel: str = ""
    chosen: int | None = None
    column: int | None = None
    brushed: tuple[int, int] | None = None
    descending: bool = True
    lines: RowLines | None = None

    @property
    def has_head(self) -> bool:
        """Whether any column has a name."""
        return any(column.name for column in self.columns)

    def sentences(self, blank: str = " ") -> Iterator[str]:
        """Yield each row as `name: column cell, column cell`; `blank` is that inside of cells."""
        for row in self.rows:
            name, *cells = row.cells
            parts = zip(self.columns[1:], cells, strict=True)
            known = [f"{column.name} {cell.whole}".strip() for column, cell in parts if cell.text]
            yield f"{name.whole}: {', '.join(text.replace(' ', blank) for text in known)}"
