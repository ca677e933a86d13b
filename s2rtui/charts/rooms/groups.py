"""The table of groups with their errors: rows in the chosen order, and the columns that fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.findings.groups import GroupErrors, Groups
from s2rtui.canvas import Mark

_FEWEST_LETTERS = 16
"""Letters of a name that are shown before further columns are."""


@dataclass(frozen=True, slots=True, eq=False)
class GroupsInput:
    """Errors per group, as `GroupErrors`, sorted by the column `sort`.

    selected: number of selected instances by group name. cursor: the name of the cursor's group.
    first: the first visible row where the table was scrolled.
    has_trained: whether the run was trained on instances in view; with_trained: they are counted.
    """

    rows: tuple[GroupErrors, ...]
    grouping: str
    selected: Mapping[str, int]
    sort: str = "real_m"
    descending: bool = True
    cursor: str | None = None
    has_trained: bool = False
    with_trained: bool = False
    mark: Mark | None = None
    first: int | None = None


def sort_value(row: GroupErrors, sort: str, selected: Mapping[str, int]) -> float:
    """The value of a column that groups are sorted by; for names, see `ordered`."""
    values = {
        "real_m": row.real.value,
        "low_m": row.real.low,
        "high_m": row.real.high,
        "sim_m": row.sim,
        "gap_m": row.gap,
        "n": float(row.n),
        "independent": independent(row),
        "selected": float(selected.get(row.group.name, 0)),
    }
    return values[sort]


def independent(row: GroupErrors) -> float:
    """How many independent instances would tell as much of the median; NaN without an interval."""
    return row.real.sample.effective_n if row.real.sample else math.nan


def ordered(data: GroupsInput) -> list[GroupErrors]:
    """The rows in the order of the table; missing values last, ties in the order of the groups."""
    if data.sort == "group":
        return list(data.rows[:: -1 if data.descending else 1])
    sign = -1 if data.descending else 1

    def key(row: GroupErrors) -> tuple[bool, float]:
        value = sort_value(row, data.sort, data.selected)
        return math.isnan(value), 0.0 if math.isnan(value) else sign * value

    return sorted(data.rows, key=key)


def selected_per_group(grouped: Groups, members: NDArray[np.bool_]) -> dict[str, int]:
    """How many of `members` (N,) each group holds, by name."""
    codes = grouped.codes[members]
    counts = np.bincount(codes[codes >= 0], minlength=len(grouped.groups)).tolist()
    return dict(zip((group.name for group in grouped.groups), counts, strict=True))


@dataclass(frozen=True, slots=True)
class TableColumn:
    """A column of the table; it shows the sort arrow if the table is sorted by one of `sorts`."""

    title: str
    sorts: tuple[str, ...]
    texts: tuple[str, ...]

    @property
    def width(self) -> int:
        return max([len(self.title) + 1, *map(len, self.texts)])


def table_columns(data: GroupsInput, rows: list[GroupErrors]) -> list[TableColumn]:
    """All columns beside the names, the most important ones first.

    A column without any value is left out, unless the table is sorted by it.
    """
    chosen = [str(data.selected.get(row.group.name, 0)) for row in rows]
    columns = (
        TableColumn("real", ("real_m",), tuple(number_text(row.real.value) for row in rows)),
        TableColumn("n", ("n",), tuple(str(row.n) for row in rows)),
        TableColumn("95 %", ("low_m", "high_m"), tuple(map(_bounds, rows))),
        TableColumn("sim", ("sim_m",), tuple(number_text(row.sim) for row in rows)),
        TableColumn("gap", ("gap_m",), tuple(number_text(row.gap, signed=True) for row in rows)),
        TableColumn("sel", ("selected",), tuple(chosen)),
        TableColumn("indep.", ("independent",), tuple(map(_independent_text, rows))),
    )
    shown = [
        column for column in columns
        if data.sort in column.sorts or any(text != "-" for text in column.texts)
    ]  # fmt: skip
    return sorted(shown, key=lambda column: data.sort not in column.sorts)


_ORDER = ("real", "95 %", "sim", "gap", "n", "indep.", "sel")


def fitting_columns(data: GroupsInput, rows: list[GroupErrors], width: int) -> list[TableColumn]:
    """The columns that fit into `width` cells beside the names of the groups, from the left."""
    longest = max((len(row.group.name) for row in rows), default=0)
    free = width - min(longest, _FEWEST_LETTERS) - 2
    chosen: list[TableColumn] = []
    for column in table_columns(data, rows):
        if column.width + 1 > free:
            break
        chosen.append(column)
        free -= column.width + 1
    return sorted(chosen, key=lambda column: _ORDER.index(column.title))


def number_text(value: float, signed: bool = False) -> str:
    """At most two decimals; `-` for a missing value."""
    if math.isnan(value):
        return "-"
    places = 2 if abs(value) < 99.995 else 0
    return f"{value:+.{places}f}" if signed else f"{value:.{places}f}"


def _independent_text(row: GroupErrors) -> str:
    count = independent(row)
    return "-" if math.isnan(count) else f"{count:.0f}"


def _bounds(row: GroupErrors) -> str:
    if not row.real.is_known:
        return "too few"
    return "..".join(row.real.bound_texts(number_text))
