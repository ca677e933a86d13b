"""The selection as a list, sorted by any of its columns."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.identity_cache import ArrayKey
from s2rtui.canvas import Canvas, RenderOptions, Size, Theme
from s2rtui.canvas.brush_surface import Mark, Panel, Point
from s2rtui.charts.table.terminal import TableColumn, TableInput, table, table_surface
from s2rtui.charts.view import Pane, Pixels, Scene, Table, View
from s2rtui.session import Session, instance_list

_UNITS = {"heading": "deg", "real.heading_error": "deg", "sim.heading_error": "deg"}
_IN_WORDS = 5


@dataclass(frozen=True, slots=True)
class _Column:
    """A column by the language's name: how it is shown, and its value of an iid."""

    name: str
    shown: TableColumn
    value: Callable[[int], object]


class ListView(View):
    name = "list"
    key = "8"
    pane: Pane = "centre"
    description = "the selection as a list"
    paper = (1600, 1200)

    def told(self, scene: Scene) -> str:
        return f"{scene.state.count}, by {scene.state.sort}: . next column, comma reverses"

    def input(self, scene: Scene) -> TableInput:
        state = scene.state
        columns = tuple(column.shown for column in self._columns(scene))
        rows = instance_list.order(scene.store, state, scene.notes)
        return TableInput(rows, columns, state.cursor, state.descending)

    def _columns(self, scene: Scene) -> list[_Column]:
        sort = scene.state.sort
        columns = [_Column("iid", TableColumn("iid", str, 8, sorts=sort == "iid"), int)]
        if sort != "iid":
            columns.append(_column(scene, sort, True))
        if sort != "room":
            columns.append(_column(scene, "room", False))
        if scene.notes.remarks and sort != instance_list.REMARK:
            columns.append(_remark(scene, False))
        others = (name for name in instance_list.COLUMNS if name not in (sort, "iid", "room"))
        return [*columns, *(_column(scene, name, False) for name in others)]

    def numbers(self, scene: Scene) -> Table:
        columns = self._columns(scene)
        iids = instance_list.order(scene.store, scene.state, scene.notes).tolist()
        rows = [[column.value(iid) for column in columns] for iid in iids]
        return [column.name for column in columns], rows

    def words(self, scene: Scene) -> str:
        sort = scene.state.sort
        rows = instance_list.order(scene.store, scene.state, scene.notes)[:_IN_WORDS].tolist()
        text = _column(scene, sort, True).shown.text
        told = ", ".join(f"{iid} ({text(iid)})" for iid in rows)
        return f"{scene.state.count} instances by {sort}: {told or 'none'}."

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.table import paper

        title = f"{scene.state.run}: instances by {scene.state.sort}"
        told = f"{scene.caption}  ·  metres and degrees"
        return paper.table_figure(self.input(scene), size, theme, title, told)

    def depends(self, scene: Scene) -> tuple[object, ...]:
        state = scene.state
        rows = ArrayKey(instance_list.order(scene.store, state, scene.notes))
        shown = state.generation, state.run, state.sort, state.descending, state.cursor
        return rows, *shown, scene.notes.remarks

    def draw(self, scene: Scene, size: Size, look: RenderOptions) -> Canvas:
        return table(self.input(scene), size, look)

    def surface(self, scene: Scene, size: Size, look: RenderOptions) -> Sequence[Panel]:
        return table_surface(self.input(scene), size, look)

    def at(self, scene: Scene, panel: Panel) -> Point | None:
        rows = instance_list.order(scene.store, scene.state, scene.notes)
        found = np.flatnonzero(rows == scene.state.cursor)
        return (0.0, float(found[0])) if found.size else (0.0, 0.0)

    def press(self, session: Session, scene: Scene, panel: Panel, point: Point) -> None:
        rows = instance_list.order(scene.store, scene.state, scene.notes)
        if 0 <= round(point[1]) < rows.size:
            session.set_cursor(int(rows[round(point[1])]))

    def meaning(self, scene: Scene, panel: Panel, mark: Mark) -> str:
        rows = instance_list.order(scene.store, scene.state, scene.notes)
        ends = sorted(round(point[1]) for point in (mark.points[0], mark.points[-1]))
        chosen = rows[max(0, ends[0]) : ends[1] + 1]
        return f"ids({', '.join(str(iid) for iid in np.sort(chosen))})"


def _column(scene: Scene, name: str, sorts: bool) -> _Column:
    if name == instance_list.REMARK:
        return _remark(scene, sorts)
    if name not in instance_list.NAMES:
        return _numbers(scene, name, sorts)
    truth = scene.store.instances
    text = _named(getattr(truth, name), getattr(truth, f"{name}_names"))
    return _texts(name, text, 16 if name == "room" else 12, sorts=sorts)


def _remark(scene: Scene, sorts: bool) -> _Column:
    return _texts(instance_list.REMARK, scene.remark, 24, "tags, note", sorts)


def _numbers(scene: Scene, name: str, sorts: bool) -> _Column:
    scale = 180 / math.pi if name in _UNITS else 1.0
    title = name.replace("heading_error", "turn")

    def value(iid: int) -> float | None:
        found = float(instance_list.column(scene.store, scene.state, name)[iid]) * scale
        return found if math.isfinite(found) else None

    def text(iid: int) -> str:
        found = value(iid)
        return (
            "n/a"
            if found is None
            else f"{found:.0f}"
            if name in instance_list.COUNTS
            else f"{found:.2f}"
        )

    shown = TableColumn(title, text, max(8, len(title) + 1), sorts=sorts)
    return _Column(name, shown, value)


def _texts(
    name: str, text: Callable[[int], str], width: int, title: str = "", sorts: bool = False
) -> _Column:
    shown = TableColumn(title or name, text, width, False, sorts)
    return _Column(name, shown, lambda iid: text(iid) or None)


def _named(codes: NDArray[np.int32], names: Sequence[str]) -> Callable[[int], str]:
    return lambda iid: names[codes[iid]] if codes[iid] >= 0 else ""
