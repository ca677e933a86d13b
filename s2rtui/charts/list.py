"""The list view: the selected instances, sorted by any column."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rstore.language import fields
from s2rstore.language.canonical_text import to_text
from s2rstore.language.syntax_tree import Ids
from s2rstore.lazy_sequence import LazySequence
from s2rtui.canvas import BrushShape, PlotArea, Point
from s2rtui.canvas.marks import mark_rows
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.list_columns import list_column, list_columns
from s2rtui.charts.view import Pane, Table, View
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.table import Cell, Row, TableSpec
from s2rtui.session import instance_list
from s2rtui.session.session import Session

_SUMMARISED = 5
"""Number of instances in the summary."""
PANEL = "rows"


class ListView(View):
    name = "list"
    needs_run = False
    key = "8"
    pane: Pane = "centre"
    description = "the selection as a list"
    needs_poses = False
    figure_size = (1600, 1200)

    def subtitle(self, scene: Scene) -> str:
        order = fields.with_unit(scene.state.sort)
        return f"{scene.state.count_text}, by {order} (. sorts, comma reverses)"

    def input(self, scene: Scene) -> NDArray[np.intp]:
        """The iids of the selected instances (n,) in their order."""
        return instance_list.order(scene.store, scene.state, scene.notes)

    def missing(self, scene: Scene) -> tuple[str, ...]:
        return () if self.input(scene).size else ("nothing is selected",)

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        iids, shown, state = self.input(scene), list_columns(scene), scene.state

        def row(place: int) -> Row:
            return Row(tuple(Cell(column.text(int(iids[place]))) for column in shown))

        brush = scene.mark(self.name)
        return Drawing(table=TableSpec(
            tuple(column.shown for column in shown), LazySequence(iids.size, row), PANEL,
            chosen=_place(iids, state.cursor), brushed=mark_rows(brush) if brush else None,
            descending=state.descending,
        ))  # fmt: skip

    def numbers(self, scene: Scene) -> Table:
        columns = list_columns(scene)
        rows = [[column.value(iid) for column in columns] for iid in self.input(scene).tolist()]
        return [fields.column_of(c.name) for c in columns], rows

    def summary(self, scene: Scene) -> str:
        text = list_column(scene, scene.state.sort).text
        iids = self.input(scene)[:_SUMMARISED].tolist()
        listed = ", ".join(f"{iid} ({text(iid)})" for iid in iids)
        order = fields.with_unit(scene.state.sort)
        return f"{scene.state.count_text} instances by {order}: {listed or 'none'}."

    def heading(self, scene: Scene) -> tuple[str, str]:
        order = fields.with_unit(scene.state.sort)
        units = "  ·  metres and degrees" * scene.store.has_poses
        return f"{scene.title}: instances by {order}", f"{scene.caption}{units}"

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        state = scene.state
        order = state.sort, state.descending, state.with_trained
        return *super().cache_key(scene), *order, scene.notes.remarks

    def cursor_point(self, scene: Scene, panel: PlotArea) -> Point | None:
        return 0.0, float(_place(self.input(scene), scene.state.cursor) or 0)

    def instance_at(self, scene: Scene, panel: PlotArea, cell: Point) -> int | None:
        iids = self.input(scene)
        place = round(panel.to_data(*cell)[1])
        return int(iids[place]) if 0 <= place < iids.size else None

    def click(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> None:
        iids = self.input(scene)
        if 0 <= round(point[1]) < iids.size:
            session.set_cursor(int(iids[round(point[1])]))

    def to_expression(self, scene: Scene, panel: PlotArea, mark: BrushShape) -> str:
        first, last = sorted(round(point[1]) for point in (mark.points[0], mark.points[-1]))
        return to_text(Ids.of(self.input(scene)[max(0, first) : last + 1]))


def _place(iids: NDArray[np.intp], cursor: int | None) -> int | None:
    """The place of the cursor's instance in the list."""
    places = np.flatnonzero(iids == cursor) if cursor is not None else iids[:0]
    return int(places[0]) if places.size else None


VIEW = ListView()
