"""The rooms view: errors by room, heading, curvature or trajectory; or instances per room."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from s2rstore.findings.expressions import any_of
from s2rstore.findings.groups import GroupErrors, Groups
from s2rstore.geometry.rooms import NO_ROOM
from s2rstore.index.population import INCLUDE_HINT
from s2rstore.language import to_text
from s2rtui.analysis.binning import Bins, Bools, count_selected, joint_counts, selection_indices
from s2rtui.analysis.identity_cache import ArrayKey, cached_by_identity
from s2rtui.canvas import BrushShape, PlotArea, Point
from s2rtui.canvas.marks import mark_rows
from s2rtui.charts.mark_expressions import names_expression
from s2rtui.charts.scene import LoadedGroups, Scene
from s2rtui.charts.shared.planes import SIDE_PHRASES, valid_cursor
from s2rtui.charts.view import Table, View
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.plot import Ink
from s2rtui.drawing.scale import Scale
from s2rtui.drawing.table import Bar, Cell, Column, Dot, Row, Span, StripMark, TableSpec
from s2rtui.session.error_groups import COLUMN_NAMES, COUNTS
from s2rtui.session.session import Session

SIDES: tuple[Ink, ...] = ("sim", "truth", "real")
_FIELDS = {"sim": "sim.room", "truth": "room", "real": "real.room"}
PANEL = "groups"
Counts = NDArray[np.intp]
Codes = NDArray[np.integer]


def independent(row: GroupErrors) -> float:
    """How many independent instances would tell as much of the median; NaN without an interval."""
    return row.real.sample.effective_n if row.real.sample else math.nan


def ordered(
    rows: Sequence[GroupErrors], sort: str, descending: bool, selected: Mapping[str, int]
) -> list[GroupErrors]:
    """Rows by a column of the table; missing values last, ties in the order of the groups.

    selected: number of selected instances by group.
    """
    if sort == "group":
        return list(rows[:: -1 if descending else 1])
    sign = -1 if descending else 1

    def key(row: GroupErrors) -> tuple[bool, float]:
        figures = {"real_m": row.real.value, "low_m": row.real.low, "high_m": row.real.high,
                   "sim_m": row.sim, "gap_m": row.gap, "n": row.n, "independent": independent(row),
                   "selected": selected.get(row.group.name, 0)}  # fmt: skip
        value = float(figures[sort])
        return math.isnan(value), 0.0 if math.isnan(value) else sign * value

    return sorted(rows, key=key)


def number_text(value: float, signed: bool = False) -> str:
    """At most two decimals; `-` for a missing value."""
    if math.isnan(value):
        return "-"
    places = 2 if abs(value) < 99.995 else 0
    return f"{value:+.{places}f}" if signed else f"{value:.{places}f}"


def groups_table(
    rows: Sequence[GroupErrors], grouping: str, sort: str, descending: bool,
    selected: Mapping[str, int], cursor: str | None = None, brush: BrushShape | None = None,
    chosen: int | None = None,
) -> TableSpec:  # fmt: skip
    """Median errors of groups in metres, with the interval of the real one, and their numbers.

    A column without any value is left out, unless the rows are sorted by it.
    """
    ends = [end for row in rows for end in (row.real.high, row.real.value, row.sim)]
    longest = max((end for end in ends if math.isfinite(end)), default=1.0) or 1.0
    scale = Scale(0.0, longest, ("median error (m)", "error (m)", "m"))
    texts = {
        "real": (1, ("real_m",), [number_text(row.real.value) for row in rows]),
        "95 %": (3, ("low_m", "high_m"), [_bounds(row) for row in rows]),
        "sim": (4, ("sim_m",), [number_text(row.sim) for row in rows]),
        "gap": (5, ("gap_m",), [number_text(row.gap, signed=True) for row in rows]),
        "n": (2, ("n",), [str(row.n) for row in rows]),
        "indep.": (8, ("independent",), [_independent_text(row) for row in rows]),
        "sel": (6, ("selected",), [str(selected.get(row.group.name, 0)) for row in rows]),
    }
    inks: dict[str, Ink] = {"real": "real", "sim": "sim"}
    shown = {
        name: (
            Column(
                name,
                inks.get(name, "muted"),
                right=True,
                rank=0 if sort in sorts else rank,
                sorts=sort in sorts,
            ),
            column,
        )
        for name, (rank, sorts, column) in texts.items()
        if sort in sorts or any(text != "-" for text in column)
    }
    columns = (Column(grouping, sorts=sort == "group"), *(column for column, _ in shown.values()))
    places = {at: inks[name] for at, name in enumerate(shown, start=1) if name in inks}
    made = tuple(
        Row(
            (Cell(row.group.name), *(Cell(texts[at]) for _, texts in shown.values()), _strip(row)),
            "text" if selected.get(row.group.name, 0) else "muted", inks=places,
            marked=row.group.name == cursor,
        )
        for at, row in enumerate(rows)
    )  # fmt: skip
    brushed = mark_rows(brush) if brush is not None else None
    return TableSpec((*columns, Column("", rank=7, scale=scale)), made, PANEL, brushed=brushed,
                     chosen=chosen, descending=descending)  # fmt: skip


def _strip(row: GroupErrors) -> Cell:
    marks: list[StripMark] = [Span(row.real.low, row.real.high, "real")] * row.real.is_known
    return Cell(strip=(*marks, Dot(row.sim, "sim", "sim"), Dot(row.real.value, "real", "real")))


def _bounds(row: GroupErrors) -> str:
    return "..".join(row.real.bound_texts(number_text)) if row.real.is_known else "too few"


def _independent_text(row: GroupErrors) -> str:
    count = independent(row)
    return "-" if math.isnan(count) else f"{count:.0f}"


def counts_table(
    names: Sequence[str], part: Counts, whole: Counts, cursor: Sequence[int | None] = (),
    brush: BrushShape | None = None, chosen: int | None = None,
) -> TableSpec:  # fmt: skip
    """Instances per room, (3, rows) of the selected and of all by side of `SIDES`.

    cursor: the row of one instance by side.
    """
    scale = Scale(0.0, float(max(1, whole.max(initial=0))))
    columns = [Column("room"), *(Column(side, side, scale=scale, panel=side) for side in SIDES)]
    low, high = (-1, -2) if brush is None else mark_rows(brush)
    rows = []
    for room, name in enumerate(names):
        cells = [Cell(name)]
        for place, side in enumerate(SIDES):
            count, total = int(part[place, room]), int(whole[place, room])
            strip: list[StripMark] = [Bar(count, side, total)]
            if place < len(cursor) and cursor[place] == room:
                strip.append(Dot(0.0, "cursor", "cursor"))
            if brush is not None and brush.panel == side and low <= room <= high:
                strip.append(Dot(0.0, "truth", "pointer"))
            cells.append(Cell(f"{_brief(count)}/{_brief(total)}", strip=tuple(strip)))
        rows.append(Row(tuple(cells), marked=len(cursor) > 1 and cursor[1] == room))
    brushed = mark_rows(brush) if brush is not None else None
    return TableSpec(tuple(columns), tuple(rows), brushed=brushed, chosen=chosen)


def _brief(count: int) -> str:
    """At most five characters."""
    return str(count) if count < 100_000 else f"{count // 1000}k"


@cached_by_identity(4)
def room_counts(
    rooms: tuple[Codes, ...], number: int, selected: Bools, valid: Bools
) -> tuple[Counts, Counts]:
    """Counts (3, number + 1) of selected and of all by room; the last column is "no room"."""
    bins = [_bins(column, number) for column in rooms]
    counted = joint_counts(bins, selection_indices(selected, valid))
    part, whole = (np.stack(each) for each in zip(*counted, strict=True))
    return part, whole


@cached_by_identity(32)
def _bins(rooms: Codes, number: int) -> Bins:
    """The room of each instance as bins; the last one is "no room"."""
    inside = (rooms >= 0) & (rooms < number)
    kind = np.uint16 if number < (1 << 16) - 1 else np.uint32
    return Bins(np.where(inside, rooms, number).astype(kind), number + 1)


class RoomsView(View):
    name = "rooms"
    has_rows = True
    key = "6"
    description = "errors by room, heading, curvature or trajectory; instances per room"
    loads = ("groups",)

    def subtitle(self, scene: Scene) -> str:
        if scene.state.grouping == COUNTS:
            return "instances per room: sim, truth, real (O: errors)"
        which = "" if scene.state.with_trained else "new instances, "
        return f"{which}m (O: group, .: sort)"

    def _rooms(self, scene: Scene) -> tuple[Codes, ...]:
        columns = scene.store.run_columns(scene.state.run)
        return columns.sim.room, scene.store.instances.room, columns.real.room

    def _counts(self, scene: Scene) -> tuple[tuple[str, ...], Counts, Counts]:
        """Names of the rooms, "no room" last if it occurs, and the counts of selected and all."""
        state, names = scene.state, scene.store.instances.room_names
        part, whole = room_counts(self._rooms(scene), len(names), state.selected, state.base)
        if whole[:, -1].any():
            return (*names, NO_ROOM), part, whole
        return names, part[:, :-1], whole[:, :-1]

    def _groups(
        self, scene: Scene
    ) -> tuple[list[GroupErrors], Mapping[str, int], LoadedGroups] | None:
        """The rows in their order and the selected instances of each; None until computed."""
        state, loaded = scene.state, scene.loaded.current_groups(scene.state)
        if loaded is None:
            return None
        selected = selected_per_group(loaded.grouped, state.selected, state.base)
        rows = ordered(loaded.rows, state.group_sort, state.group_descending, selected)
        return rows, selected, loaded

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        state = scene.state
        order = state.grouping, state.group_sort, state.group_descending, state.with_trained
        return *super().cache_key(scene), *order, ArrayKey(state.trained), scene.loaded.groups

    def missing(self, scene: Scene) -> tuple[str, ...]:
        state = scene.state
        if state.grouping == COUNTS:
            return () if self._counts(scene)[0] else ("no rooms",)
        found = self._groups(scene)
        if found is None:
            return (scene.loaded.failed.get("groups", "errors are being computed"),)
        if found[0]:
            return ()
        if state.trained.any() and not state.with_trained:
            return (f"no instance is new to the run: {INCLUDE_HINT}",)
        return ("no instances",)

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        state, brush, chosen = scene.state, scene.mark(self.name), self.chosen_row(scene)
        if state.grouping == COUNTS:
            table = counts_table(*self._counts(scene), self._cursor_rows(scene), brush, chosen)
            return Drawing(table=table)
        found = self._groups(scene)
        assert found is not None
        rows, selected, loaded = found
        cursor = _group_of(loaded, state.cursor)
        order = state.grouping, state.group_sort, state.group_descending
        return Drawing(table=groups_table(rows, *order, selected, cursor, brush, chosen))

    def paper_drawing(self, scene: Scene) -> Drawing:
        """With a legend of the strips, which remain where columns are left out."""
        notes = () if scene.state.grouping == COUNTS else (SIDE_PHRASES,)
        return replace(super().paper_drawing(scene), notes=notes)

    def row_names(self, scene: Scene) -> Sequence[str]:
        if scene.state.grouping == COUNTS:
            return self._counts(scene)[0]
        found = self._groups(scene)
        return [row.group.name for row in found[0]] if found else []

    def first_choice(self, scene: Scene) -> int:
        """The row of the cursor's instance, on the shown side where rooms are counted."""
        if scene.state.grouping == COUNTS:
            rows = dict(zip(SIDES, self._cursor_rows(scene), strict=False))
            return rows.get(scene.state.side) or 0
        found, names = self._groups(scene), list(self.row_names(scene))
        name = _group_of(found[2], scene.state.cursor) if found else None
        return names.index(name) if name in names else 0

    def row_expression(self, scene: Scene, row: int) -> str:
        name = scene.state.side if scene.state.grouping == COUNTS else PANEL
        point = (0.0, float(row))
        return self._expression(scene, name, BrushShape(name, (point, point)))

    def _cursor_rows(self, scene: Scene) -> tuple[int | None, ...]:
        cursor = valid_cursor(scene.state.cursor, scene.state.base)
        if cursor is None:
            return ()
        number = len(scene.store.instances.room_names)
        codes = (int(side[cursor]) for side in self._rooms(scene))
        return tuple(code if 0 <= code < number else number for code in codes)

    def heading(self, scene: Scene) -> tuple[str, str]:
        state = scene.state
        if state.grouping == COUNTS:
            return f"{state.run}: instances per room, selected/all", scene.caption
        which = "trained instances included" if state.with_trained else "instances new to the run"
        return f"{state.run}: errors by {state.grouping}", f"{scene.caption}  ·  {which}"

    def numbers(self, scene: Scene) -> Table:
        if scene.state.grouping == COUNTS:
            rooms, part, whole = self._counts(scene)
            names = ("room", *SIDES, *(f"{side} of all" for side in SIDES))
            return names, list(zip(rooms, *part.tolist(), *whole.tolist(), strict=True))
        found = self._groups(scene)
        titles = (scene.state.grouping, *(name for name in COLUMN_NAMES if name != "group"), "note")
        return titles, [_numbers(row, found[1]) for row in found[0]] if found else []

    def cursor_point(self, scene: Scene, panel: PlotArea) -> Point | None:
        if panel.name != PANEL:
            rows = dict(zip(SIDES, self._cursor_rows(scene), strict=False))
            row = rows.get(panel.name)  # type: ignore[call-overload]
            return None if row is None else (0.0, float(row))
        chosen = self.chosen_row(scene)
        return None if chosen is None else (0.0, float(chosen))

    def click(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> None:
        if panel.name == PANEL:
            super().click(session, scene, panel, point)
        else:
            session.select(self.to_expression(scene, panel, BrushShape(panel.name, (point, point))))

    def to_expression(self, scene: Scene, panel: PlotArea, mark: BrushShape) -> str:
        return self._expression(scene, panel.name, mark)

    def _expression(self, scene: Scene, panel: str, mark: BrushShape) -> str:
        if panel != PANEL:
            return names_expression(mark, _FIELDS[panel], scene.store.instances.room_names)
        found, (low, high) = self._groups(scene), mark_rows(mark)
        chosen = found[0][max(0, low) : high + 1] if found else []
        return to_text(any_of(row.group.node for row in chosen)) if chosen else "none"


def _group_of(loaded: LoadedGroups, cursor: int | None) -> str | None:
    """The name of the group that holds an instance; None without one."""
    code = -1 if cursor is None else int(loaded.grouped.codes[cursor])
    return loaded.grouped.groups[code].name if code >= 0 else None


@cached_by_identity(4)
def selected_per_group(grouped: Groups, selected: Bools, valid: Bools) -> dict[str, int]:
    """How many valid instances of a selection (N,) each group holds, by name."""
    bins = _group_bins(grouped.codes, len(grouped.groups))
    counts, _ = count_selected(bins, selection_indices(selected, valid))
    return dict(zip((group.name for group in grouped.groups), counts.tolist(), strict=True))


@cached_by_identity(4)
def _group_bins(codes: Codes, number: int) -> Bins:
    return Bins(np.where(codes >= 0, codes, number).astype(np.uint32), number)


def _numbers(row: GroupErrors, selected: Mapping[str, int]) -> tuple[object, ...]:
    figures = row.real.value, *row.real.bounds, row.sim, row.gap
    known = (None if math.isnan(value) else value for value in figures)
    count = independent(row)
    return (
        row.group.name, *known, row.n, None if math.isnan(count) else round(count, 1),
        selected.get(row.group.name, 0), row.real.no_bounds,
    )  # fmt: skip


VIEW = RoomsView()
