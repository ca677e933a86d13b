"""Errors by room, heading, curvature or trajectory; or instances per predicted and true room."""

from __future__ import annotations

import math
from collections.abc import Sequence

from s2rstore.findings.expressions import any_of
from s2rstore.findings.groups import GroupErrors
from s2rstore.language import to_text
from s2rtui.analysis.identity_cache import identity_key
from s2rtui.canvas import Canvas, Mark, Panel, Point, RenderOptions, Size, Theme
from s2rtui.canvas.marks import mark_rows
from s2rtui.charts.mark_expressions import names_expression
from s2rtui.charts.rooms.groups import (
    GroupsInput,
    independent,
    number_text,
    ordered,
    selected_per_group,
)
from s2rtui.charts.rooms.groups_terminal import (
    PANEL,
    draw_groups,
    groups_layout,
    groups_panels,
)
from s2rtui.charts.rooms.model import RoomsInput, rooms_model
from s2rtui.charts.rooms.terminal import draw_rooms, rooms_layout, rooms_panels
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import Pixels, Table, TableWindow, View
from s2rtui.session import Session
from s2rtui.session.error_groups import COLUMN_NAMES, COUNTS

_FIELDS = {"sim": "sim.room", "truth": "room", "real": "real.room"}
_SUMMARISED = 3
"""Number of groups in the summary."""


class RoomsView(View):
    name = "rooms"
    key = "6"
    description = "errors by room, heading, curvature or trajectory; instances per room"
    loads = ("groups",)
    narrow_ratio = 1.2

    def subtitle(self, scene: Scene) -> str:
        if scene.state.grouping == COUNTS:
            return "instances per room: sim, truth, real (O: errors)"
        which = "" if scene.state.with_trained else "new instances, "
        return f"{which}m (O: group, .: sort)"

    def _counts(self, scene: Scene) -> RoomsInput:
        store, state = scene.store, scene.state
        columns, truth = store.run_columns(state.run), store.instances
        return RoomsInput(
            columns.sim.room, truth.room, columns.real.room, truth.room_names, state.selected,
            state.base, state.cursor, scene.mark(self.name), state.first_row(self.name),
        )  # fmt: skip

    def _groups(self, scene: Scene) -> GroupsInput | None:
        """The table of groups; None until it is computed."""
        state, loaded = scene.state, scene.resources.current_groups(scene.state)
        if loaded is None:
            return None
        grouped = loaded.grouped
        cursor = None
        if state.cursor is not None and grouped.codes[state.cursor] >= 0:
            cursor = grouped.groups[int(grouped.codes[state.cursor])].name
        return GroupsInput(
            loaded.rows, state.grouping, selected_per_group(grouped, state.selected & state.base),
            state.group_sort, state.group_descending, cursor,
            bool(state.trained.any()), state.with_trained, scene.mark(self.name),
            state.first_row(self.name),
        )  # fmt: skip

    def input(self, scene: Scene) -> RoomsInput | GroupsInput | None:
        return self._counts(scene) if scene.state.grouping == COUNTS else self._groups(scene)

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        state = scene.state
        if state.grouping == COUNTS:
            return (identity_key(self._counts(scene)),)
        order = state.grouping, state.group_sort, state.group_descending
        shown = order, scene.mark(self.name), state.first_row(self.name)
        arrays = identity_key((state.selected, state.base, state.trained))
        loaded, failed = scene.resources.groups, scene.resources.failed.get("groups")
        place = state.generation, state.run, state.with_trained, state.cursor
        return *place, shown, arrays, loaded, failed

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        data = self.input(scene)
        if isinstance(data, RoomsInput):
            return draw_rooms(data, size, options)
        if data is not None:
            return draw_groups(data, size, options)
        canvas = Canvas(*size, options)
        failed = scene.resources.failed.get("groups", "errors are being computed")
        canvas.text(0, 0, failed, options.theme.muted)
        return canvas

    def table_window(self, scene: Scene, size: Size, options: RenderOptions) -> TableWindow | None:
        data = self.input(scene)
        if data is None:
            return None
        if isinstance(data, RoomsInput):
            layout = rooms_layout(data, size)
            return TableWindow(layout.first, layout.shown, len(rooms_model(data).names))
        table = groups_layout(data, size)
        return TableWindow(table.first, table.shown, len(table.rows))

    def numbers(self, scene: Scene) -> Table:
        data = self.input(scene)
        if isinstance(data, RoomsInput):
            model = rooms_model(data)
            counted = model.names, *model.highlighted.tolist(), *model.total.tolist()
            names = ("room", "sim", "truth", "real", "sim of all", "truth of all", "real of all")
            return names, list(zip(*counted, strict=True))
        titles = (scene.state.grouping, *(name for name in COLUMN_NAMES if name != "group"))
        return (*titles, "note"), [_row(row, data) for row in ordered(data)] if data else []

    def summary(self, scene: Scene) -> str:
        data = self.input(scene)
        if isinstance(data, RoomsInput):
            _, counted = self.numbers(scene)
            counts = [f"{row[0]} {row[1]}, {row[2]}, {row[3]}" for row in counted if any(row[1:4])]
            return f"Instances per room in sim, truth and real: {'; '.join(counts) or 'none'}."
        rows = ordered(data)[:_SUMMARISED] if data else []
        listed = "; ".join(
            f"{row.group.name} {number_text(row.real.value)} m real, {number_text(row.sim)} m sim, "
            f"n {row.n}"
            for row in rows
        )
        which = "instances, trained ones included" if scene.state.with_trained else "new instances"
        by = f"Median errors by {scene.state.grouping} over {which}"
        return f"{by}, sorted by {scene.state.group_sort}: {listed or 'none'}."

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.rooms import groups_paper, paper

        data = self.input(scene)
        if isinstance(data, RoomsInput):
            title = f"{scene.state.run}: rooms in simulation, in truth and in reality"
            return paper.rooms_figure(data, size, theme, title, scene.caption)
        title = f"{scene.state.run}: errors by {scene.state.grouping}"
        empty = GroupsInput((), scene.state.grouping, {})
        included = scene.state.with_trained
        counted = "trained instances included" if included else "instances new to the run"
        subtitle = f"{scene.caption}  ·  {counted}"
        return groups_paper.groups_figure(data or empty, size, theme, title, subtitle)

    def panels(self, scene: Scene, size: Size, options: RenderOptions) -> Sequence[Panel]:
        data = self.input(scene)
        if isinstance(data, RoomsInput):
            return rooms_panels(data, size, options)
        return groups_panels(data, size, options) if data is not None else ()

    def cursor_point(self, scene: Scene, panel: Panel) -> Point | None:
        data = self.input(scene)
        if isinstance(data, RoomsInput):
            if scene.state.cursor is None:
                return None
            code = int(getattr(data, panel.name)[scene.state.cursor])
            return (0.0, float(code)) if code >= 0 else None
        names = [row.group.name for row in ordered(data)] if data is not None else []
        return (0.0, float(names.index(data.cursor))) if data and data.cursor in names else None

    def click(self, session: Session, scene: Scene, panel: Panel, point: Point) -> None:
        mark = Mark(panel.name, (point, point))
        session.select(self.to_expression(scene, panel, mark))

    def to_expression(self, scene: Scene, panel: Panel, mark: Mark) -> str:
        if panel.name != PANEL:
            names = scene.store.instances.room_names
            return names_expression(mark, _FIELDS[panel.name], names)
        data = self._groups(scene)
        rows = ordered(data) if data is not None else []
        low, high = mark_rows(mark)
        chosen = rows[max(0, low) : high + 1]
        return to_text(any_of(row.group.node for row in chosen)) if chosen else "none"


VIEW = RoomsView()


def _row(row: GroupErrors, data: GroupsInput) -> tuple[object, ...]:
    figures = row.real.value, *row.real.bounds, row.sim, row.gap
    known = (None if math.isnan(value) else value for value in figures)
    count = independent(row)
    return (
        row.group.name, *known, row.n, None if math.isnan(count) else round(count, 1),
        data.selected.get(row.group.name, 0), row.real.no_bounds,
    )  # fmt: skip
