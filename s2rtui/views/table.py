"""The selection as a list, sorted by any of its columns."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from s2rtui.canvas import Canvas, Look, Size
from s2rtui.plots.surface import Mark, Panel, Point
from s2rtui.plots.table import TableColumn, TableInput, table, table_surface
from s2rtui.session import Session, listing
from s2rtui.views.contract import Pane, Scene, Table, View

_UNITS = {"heading": "deg", "real.heading_error": "deg", "sim.heading_error": "deg"}


class ListView(View):
    name = "list"
    key = "8"
    pane: Pane = "centre"
    description = "the selection as a list"

    def told(self, scene: Scene) -> str:
        return f"{scene.state.count}, by {scene.state.sort}: . next column, comma reverses"

    def input(self, scene: Scene) -> TableInput:
        state, store = scene.state, scene.store
        truth = store.instances
        chosen = [state.sort, *(name for name in listing.COLUMNS if name != state.sort)]
        columns = [TableColumn("iid", str, 8, sorts=state.sort == "iid")]
        if state.sort != "iid":
            columns.append(self._numbers(scene, state.sort, True))
        columns.append(TableColumn("room", _named(truth.room, truth.room_names), 16, False))
        if scene.notes.remarks:
            columns.append(TableColumn("tags, note", scene.remark, 24, False))
        columns += [self._numbers(scene, name, False) for name in chosen[1:] if name != "iid"]
        trajectory = _named(truth.trajectory, truth.trajectory_names)
        columns.append(TableColumn("trajectory", trajectory, 12, False))
        rows = listing.order(store, state)
        return TableInput(rows, tuple(columns), state.cursor, state.descending)

    def _numbers(self, scene: Scene, name: str, sorts: bool) -> TableColumn:
        values = listing.column(scene.store, scene.state, name)
        scale = 180 / math.pi if name in _UNITS else 1.0
        title = name.replace("heading_error", "turn")
        return TableColumn(title, _number(values, scale), max(8, len(title) + 1), sorts=sorts)

    def numbers(self, scene: Scene) -> Table:
        view = self.input(scene)
        rows = [[column.text(int(iid)) for column in view.columns] for iid in view.rows]
        return [column.title for column in view.columns], rows

    def draw(self, scene: Scene, size: Size, look: Look) -> Canvas:
        return table(self.input(scene), size, look)

    def surface(self, scene: Scene, size: Size, look: Look) -> Sequence[Panel]:
        return table_surface(self.input(scene), size, look)

    def at(self, scene: Scene, panel: Panel) -> Point | None:
        rows = listing.order(scene.store, scene.state)
        found = np.flatnonzero(rows == scene.state.cursor)
        return (0.0, float(found[0])) if found.size else (0.0, 0.0)

    def press(self, session: Session, scene: Scene, panel: Panel, point: Point) -> None:
        rows = listing.order(scene.store, scene.state)
        if 0 <= round(point[1]) < rows.size:
            session.put_cursor(int(rows[round(point[1])]))

    def meaning(self, scene: Scene, panel: Panel, mark: Mark) -> str:
        rows = listing.order(scene.store, scene.state)
        ends = sorted(round(point[1]) for point in (mark.points[0], mark.points[-1]))
        chosen = rows[max(0, ends[0]) : ends[1] + 1]
        return f"ids({', '.join(str(iid) for iid in np.sort(chosen))})"


def _number(values: NDArray[np.float64], scale: float) -> Callable[[int], str]:
    def text(iid: int) -> str:
        value = float(values[iid]) * scale
        return f"{value:.2f}" if math.isfinite(value) else "n/a"

    return text


def _named(codes: NDArray[np.int32], names: Sequence[str]) -> Callable[[int], str]:
    return lambda iid: names[codes[iid]] if codes[iid] >= 0 else ""
