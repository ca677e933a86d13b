"""How the rooms view groups and sorts: the reducers of its keys."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

from s2rstore.findings.groups import Grouping, crossed, parts_of
from s2rtui.session.context import SessionContext
from s2rtui.session.state import State

COUNTS = "counts"
"""The rooms view's comparison of predicted and true rooms, in the place of a grouping."""
GROUPINGS: tuple[str, ...] = (*get_args(Grouping), COUNTS)


@dataclass(frozen=True, slots=True)
class SortColumn:
    """A column of the table of groups: its `name` in tables and options, and what it says."""

    name: str
    meaning: str
    descending: bool = True


COLUMNS = tuple(
    SortColumn(*column)
    for column in (
        ("real_m", "median real error"),
        ("low_m", "lower bound of the median real error"),
        ("high_m", "upper bound of the median real error"),
        ("sim_m", "median sim error"),
        ("gap_m", "median of real error minus sim error"),
        ("n", "number of instances"),
        ("independent", "number of instances that count as independent"),
        ("selected", "number of selected instances"),
        ("group", "name", False),
    )
)
"""Columns in the order in which the key goes through them."""
_BY_NAME = {column.name: column for column in COLUMNS}
COLUMN_NAMES = tuple(_BY_NAME)


@dataclass(frozen=True, slots=True)
class PivotFigure:
    """What the cells of the pivot show: its `name`, what it says, its unit and its factor."""

    name: str
    meaning: str
    unit: str
    factor: float = 1.0


FIGURES = {
    figure.name: figure
    for figure in (
        PivotFigure("median", "median real error", "m"),
        PivotFigure("n", "number of instances", ""),
        PivotFigure("recall", "share within the thresholds of recall in reality", "%", 100.0),
        PivotFigure("share", "share of the sum of all real errors", "%", 100.0),
    )
}
"""Figures of the pivot in the order in which the key goes through them."""


def pivot_grouping(state: State) -> str:
    """The two groupings of the pivot: those of the state, a single one with another one."""
    first = state.grouping if state.grouping != COUNTS else "room"
    if len(parts_of(first)) > 1:
        return first
    return crossed(first, "room" if first == "heading" else "heading")


def change_figure(context: SessionContext, state: State) -> State:
    """Show the next figure in the cells of the pivot."""
    names = list(FIGURES)
    name = names[(names.index(state.figure) + 1) % len(names)]
    return state.updated(figure=name, message=f"cells: {FIGURES[name].meaning}")


def change_grouping(context: SessionContext, state: State) -> State:
    """Group by the next of room, heading, curvature and trajectory; then compare room counts."""
    first = state.grouping.partition(",")[0]
    grouping = GROUPINGS[(GROUPINGS.index(first) + 1) % len(GROUPINGS)]
    message = f"errors by {grouping}"
    if grouping == COUNTS:
        message = "instances per room: predicted in sim, true, predicted in reality"
    return state.updated(grouping=grouping, message=message)


def cross_grouping(context: SessionContext, state: State) -> State:
    """Group by a second grouping within the first: the next one, then none."""
    if state.grouping == COUNTS:
        return state.with_message("counts have no second grouping; O shows errors")
    first, *second = parts_of(state.grouping)
    others = [None, *(other for other in get_args(Grouping) if other != first)]
    following = others[(others.index(second[0] if second else None) + 1) % len(others)]
    grouping = first if following is None else crossed(first, following)
    message = f"errors by {' and '.join(parts_of(grouping))}"
    return state.updated(grouping=grouping, message=message)


def sort_by_next_column(context: SessionContext, state: State) -> State:
    """Sort the groups by the next column, the largest first; names ascend."""
    if state.grouping == COUNTS:
        return state.with_message("counts keep the order of the rooms; O shows errors")
    at = (COLUMN_NAMES.index(state.group_sort) + 1) % len(COLUMNS)
    column = COLUMNS[at]
    message = f"sorted by {column.meaning}"
    return state.updated(
        group_sort=column.name, group_descending=column.descending, message=message
    )


def reverse(context: SessionContext, state: State) -> State:
    """Reverse the order of the groups."""
    return state.updated(group_descending=not state.group_descending)
