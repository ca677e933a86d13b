"""Rooms of the selection: where sim says that it is, where it is, where real says so."""

from __future__ import annotations

from collections.abc import Sequence

from s2rtui.analysis.identity_cache import identity
from s2rtui.canvas import Canvas, RenderOptions, Size, Theme
from s2rtui.canvas.brush_surface import Mark, Panel, Point
from s2rtui.charts.rooms.model import rooms_model
from s2rtui.charts.rooms.terminal import rooms, rooms_surface
from s2rtui.charts.shared import inputs
from s2rtui.charts.view import Pixels, Scene, Table, View, named
from s2rtui.session import Session

_FIELDS = {"sim": "sim.room", "truth": "room", "real": "real.room"}


class RoomsView(View):
    name = "rooms"
    key = "6"
    description = "rooms: predicted in sim, true, predicted in reality"

    def told(self, scene: Scene) -> str:
        return "rooms: sim, truth, real"

    def input(self, scene: Scene) -> inputs.RoomsInput:
        store, state = scene.store, scene.state
        columns, truth = store.run_columns(state.run), store.instances
        return inputs.RoomsInput(
            columns.sim.room, truth.room, columns.real.room, truth.room_names, state.selected,
            state.base, state.cursor, scene.mark(self.name),
        )  # fmt: skip

    def numbers(self, scene: Scene) -> Table:
        model = rooms_model(self.input(scene))
        rows = list(zip(model.names, *model.lit.tolist(), *model.total.tolist(), strict=True))
        names = ("room", "sim", "truth", "real", "sim of all", "truth of all", "real of all")
        return names, rows

    def words(self, scene: Scene) -> str:
        _, rows = self.numbers(scene)
        told = [f"{row[0]} {row[1]}, {row[2]}, {row[3]}" for row in rows if any(row[1:4])]
        return f"Instances per room in sim, truth and real: {'; '.join(told) or 'none'}."

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.rooms import paper

        title = f"{scene.state.run}: rooms in simulation, in truth and in reality"
        return paper.rooms_figure(self.input(scene), size, theme, title, scene.caption)

    def depends(self, scene: Scene) -> tuple[object, ...]:
        return (identity(self.input(scene)),)

    def draw(self, scene: Scene, size: Size, look: RenderOptions) -> Canvas:
        return rooms(self.input(scene), size, look)

    def surface(self, scene: Scene, size: Size, look: RenderOptions) -> Sequence[Panel]:
        return rooms_surface(self.input(scene), size, look)

    def at(self, scene: Scene, panel: Panel) -> Point | None:
        if scene.state.cursor is None:
            return None
        code = int(getattr(self.input(scene), panel.name)[scene.state.cursor])
        return (0.0, float(code)) if code >= 0 else None

    def press(self, session: Session, scene: Scene, panel: Panel, point: Point) -> None:
        mark = Mark(panel.name, (point, point))
        session.select(self.meaning(scene, panel, mark))

    def meaning(self, scene: Scene, panel: Panel, mark: Mark) -> str:
        return named(mark, _FIELDS[panel.name], scene.store.instances.room_names)
