"""The list view: the selected instances, sorted by any column."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from s2rstore.language import fields
from s2rtui.analysis.identity_cache import ArrayKey
from s2rtui.canvas import BrushShape, PlotArea, Point
from s2rtui.canvas.marks import mark_rows
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import Pane, Table, View
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.table import Cell, Column, LazyRows, Row, TableSpec
from s2rtui.session import instance_list
from s2rtui.session.session import Session

_SUMMARISED = 5
"""Number of instances in the summary."""
_DEGREES = ("heading", "real.heading_error", "sim.heading_error")
"""Columns of radians that are shown in degrees."""
PANEL = "rows"


@dataclass(frozen=True, slots=True)
class ListColumn:
    """A column named as in the selection language: its display, and text and value of an iid.

    On the screen the name ends with the unit, as in the columns of `s2r show` and `s2r query`.
    """

    name: str
    shown: Column
    text: Callable[[int], str]
    value: Callable[[int], object]


def list_columns(scene: Scene) -> list[ListColumn]:
    """The column that sorts after the number of the instance, then the most important others."""
    sort = scene.state.sort
    stored = instance_list.stored_columns(scene.store)
    names = ["iid", sort] if sort != "iid" else ["iid"]
    names += ["room"] if "room" in stored else []
    names += ["split"] if scene.state.marked is not None else []
    names += [instance_list.REMARK] if scene.notes.remarks else []
    names = list(dict.fromkeys([*names, *stored]))
    return [_column(scene, name, rank) for rank, name in enumerate(names)]


def _column(scene: Scene, name: str, rank: int = 0) -> ListColumn:
    truth = scene.store.instances
    if name == "iid":
        return _texts(scene, name, str, 8, rank, value=int, is_number=True)
    if name == instance_list.REMARK:
        return _texts(scene, name, scene.remark, 24, rank, "tags, note")
    if name == "split":
        return _texts(scene, name, lambda iid: scene.splits(np.array([iid]))[0] or "", 11, rank)
    if name not in instance_list.NAMES:
        return _numbers(scene, name, rank)
    text = _named(getattr(truth, name), getattr(truth, f"{name}_names"))
    return _texts(scene, name, text, 16 if name == "room" else 12, rank)


def _numbers(scene: Scene, name: str, rank: int) -> ListColumn:
    scale = 180 / math.pi if name in _DEGREES else 1.0
    title = fields.with_unit(name)

    @cache
    def numbers() -> NDArray[np.float64]:
        return instance_list.column(scene.store, scene.state, name)

    def value(iid: int) -> float | None:
        number = float(numbers()[iid]) * scale
        return number if math.isfinite(number) else None

    def text(iid: int) -> str:
        number = value(iid)
        if number is None:
            return "n/a"
        return f"{number:.0f}" if name in instance_list.COUNTS else f"{number:.2f}"

    return ListColumn(name, _shown(scene, name, title, max(8, len(title) + 1), rank), text, value)


def _texts(
    scene: Scene, name: str, text: Callable[[int], str], width: int, rank: int, title: str = "",
    value: Callable[[int], object] | None = None, is_number: bool = False,
) -> ListColumn:  # fmt: skip
    shown = _shown(scene, name, title or name, width, rank, is_number)
    return ListColumn(name, shown, text, value or (lambda iid: text(iid) or None))


def _shown(
    scene: Scene, name: str, title: str, width: int, rank: int, is_number: bool = True
) -> Column:
    return Column(title, right=is_number, sorts=scene.state.sort == name, rank=rank, least=width,
                  is_cut=not is_number)  # fmt: skip


def _named(codes: NDArray[np.int32], names: Sequence[str]) -> Callable[[int], str]:
    return lambda iid: names[codes[iid]] if codes[iid] >= 0 else ""


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
            tuple(column.shown for column in shown), LazyRows(iids.size, row), PANEL,
            chosen=_place(iids, state.cursor), brushed=mark_rows(brush) if brush else None,
            descending=state.descending,
        ))  # fmt: skip

    def numbers(self, scene: Scene) -> Table:
        columns = list_columns(scene)
        rows = [[column.value(iid) for column in columns] for iid in self.input(scene).tolist()]
        return [fields.column_of(c.name) for c in columns], rows

    def summary(self, scene: Scene) -> str:
        text = _column(scene, scene.state.sort).text
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
        shown = state.generation, state.run, state.sort, state.descending, state.cursor
        brush = scene.mark(self.name)
        return ArrayKey(self.input(scene)), *shown, state.with_trained, scene.notes.remarks, brush

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
        chosen = np.sort(self.input(scene)[max(0, first) : last + 1])
        return f"ids({', '.join(str(iid) for iid in chosen)})"


def _place(iids: NDArray[np.intp], cursor: int | None) -> int | None:
    """The place of the cursor's instance in the list."""
    places = np.flatnonzero(iids == cursor) if cursor is not None else iids[:0]
    return int(places[0]) if places.size else None


VIEW = ListView()
