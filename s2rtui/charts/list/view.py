"""The list of the selected instances, sorted by any column."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from s2rstore.language import fields
from s2rtui.analysis.identity_cache import ArrayKey
from s2rtui.canvas import Canvas, Mark, Panel, Point, RenderOptions, Size, Theme
from s2rtui.charts.list.model import ListColumn, ListInput, _Column, _column, _remark, _split
from s2rtui.charts.list.terminal import draw_list, list_panels
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import Pane, Pixels, Table, View
from s2rtui.session import Session, instance_list

_SUMMARISED = 5
"""Number of instances in the summary."""


class ListView(View):
    name = "list"
    needs_run = False
    key = "8"
    pane: Pane = "centre"
    description = "the selection as a list"
    narrow_ratio = 1.0
    needs_poses = False
    figure_size = (1600, 1200)

    def subtitle(self, scene: Scene) -> str:
        order = fields.with_unit(scene.state.sort)
        return f"{scene.state.count}, by {order} (. sorts, comma reverses)"

    def input(self, scene: Scene) -> ListInput:
        state = scene.state
        columns = tuple(column.shown for column in self._columns(scene))
        rows = instance_list.order(scene.store, state, scene.notes)
        return ListInput(rows, columns, state.cursor, state.descending)

    def _columns(self, scene: Scene) -> list[_Column]:
        sort = scene.state.sort
        columns = [_Column("iid", ListColumn("iid", str, 8, sorts=sort == "iid"), int)]
        if sort != "iid":
            columns.append(_column(scene, sort, True))
        names = instance_list.stored_columns(scene.store)
        if sort != "room" and "room" in names:
            columns.append(_column(scene, "room", False))
        if scene.state.marked is not None:
            columns.append(_split(scene))
        if scene.notes.remarks and sort != instance_list.REMARK:
            columns.append(_remark(scene, False))
        others = (name for name in names if name not in (sort, "iid", "room"))
        return [*columns, *(_column(scene, name, False) for name in others)]

    def numbers(self, scene: Scene) -> Table:
        columns = self._columns(scene)
        iids = instance_list.order(scene.store, scene.state, scene.notes).tolist()
        rows = [[column.value(iid) for column in columns] for iid in iids]
        return [fields.with_unit(c.name).replace(".", "_") for c in columns], rows

    def summary(self, scene: Scene) -> str:
        sort = scene.state.sort
        rows = instance_list.order(scene.store, scene.state, scene.notes)[:_SUMMARISED].tolist()
        text = _column(scene, sort, True).shown.text
        listed = ", ".join(f"{iid} ({text(iid)})" for iid in rows)
        return f"{scene.state.count} instances by {fields.with_unit(sort)}: {listed or 'none'}."

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.list import paper

        title = f"{scene.title}: instances by {fields.with_unit(scene.state.sort)}"
        subtitle = f"{scene.caption}{'  ·  metres and degrees' * scene.store.has_poses}"
        return paper.list_figure(self.input(scene), size, theme, title, subtitle)

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        state = scene.state
        rows = ArrayKey(instance_list.order(scene.store, state, scene.notes))
        shown = state.generation, state.run, state.sort, state.descending, state.cursor
        return rows, *shown, scene.state.with_trained, scene.notes.remarks

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        return draw_list(self.input(scene), size, options)

    def panels(self, scene: Scene, size: Size, options: RenderOptions) -> Sequence[Panel]:
        return list_panels(self.input(scene), size, options)

    def cursor_point(self, scene: Scene, panel: Panel) -> Point | None:
        rows = instance_list.order(scene.store, scene.state, scene.notes)
        places = np.flatnonzero(rows == scene.state.cursor)
        return (0.0, float(places[0])) if places.size else (0.0, 0.0)

    def instance_at(self, scene: Scene, panel: Panel, cell: Point) -> int | None:
        rows = instance_list.order(scene.store, scene.state, scene.notes)
        index = round(panel.to_data(*cell)[1])
        return int(rows[index]) if 0 <= index < rows.size else None

    def click(self, session: Session, scene: Scene, panel: Panel, point: Point) -> None:
        rows = instance_list.order(scene.store, scene.state, scene.notes)
        if 0 <= round(point[1]) < rows.size:
            session.set_cursor(int(rows[round(point[1])]))

    def to_expression(self, scene: Scene, panel: Panel, mark: Mark) -> str:
        rows = instance_list.order(scene.store, scene.state, scene.notes)
        ends = sorted(round(point[1]) for point in (mark.points[0], mark.points[-1]))
        selection = rows[max(0, ends[0]) : ends[1] + 1]
        return f"ids({', '.join(str(iid) for iid in np.sort(selection))})"


VIEW = ListView()
