"""The rooms of the selection: predicted in sim, true, predicted in real."""

from __future__ import annotations

from collections.abc import Sequence

from s2rtui.canvas import Canvas, Mark, Panel, Point, RenderOptions, Size, Theme
from s2rtui.charts.mark_expressions import names_expression
from s2rtui.charts.rooms.model import RoomsInput, rooms_model
from s2rtui.charts.rooms.terminal import draw_rooms, rooms_panels
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import Pixels, Table, View
from s2rtui.session import Session

_FIELDS = {"sim": "sim.room", "truth": "room", "real": "real.room"}


class RoomsView(View):
    name = "rooms"
    key = "6"
    description = "rooms: predicted in sim, true, predicted in reality"
    narrow_ratio = 1.2

    def subtitle(self, scene: Scene) -> str:
        return "instances per room: sim, truth, real"

    def input(self, scene: Scene) -> RoomsInput:
        store, state = scene.store, scene.state
        columns, truth = store.run_columns(state.run), store.instances
        return RoomsInput(
            columns.sim.room, truth.room, columns.real.room, truth.room_names, state.selected,
            state.base, state.cursor, scene.mark(self.name),
        )  # fmt: skip

    def numbers(self, scene: Scene) -> Table:
        model = rooms_model(self.input(scene))
        rows = list(
            zip(model.names, *model.highlighted.tolist(), *model.total.tolist(), strict=True)
        )
        names = ("room", "sim", "truth", "real", "sim of all", "truth of all", "real of all")
        return names, rows

    def summary(self, scene: Scene) -> str:
        _, rows = self.numbers(scene)
        counts = [f"{row[0]} {row[1]}, {row[2]}, {row[3]}" for row in rows if any(row[1:4])]
        return f"Instances per room in sim, truth and real: {'; '.join(counts) or 'none'}."

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.rooms import paper

        title = f"{scene.state.run}: rooms in simulation, in truth and in reality"
        return paper.rooms_figure(self.input(scene), size, theme, title, scene.caption)

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        return draw_rooms(self.input(scene), size, options)

    def panels(self, scene: Scene, size: Size, options: RenderOptions) -> Sequence[Panel]:
        return rooms_panels(self.input(scene), size, options)

    def cursor_point(self, scene: Scene, panel: Panel) -> Point | None:
        if scene.state.cursor is None:
            return None
        code = int(getattr(self.input(scene), panel.name)[scene.state.cursor])
        return (0.0, float(code)) if code >= 0 else None

    def click(self, session: Session, scene: Scene, panel: Panel, point: Point) -> None:
        mark = Mark(panel.name, (point, point))
        session.select(self.to_expression(scene, panel, mark))

    def to_expression(self, scene: Scene, panel: Panel, mark: Mark) -> str:
        return names_expression(mark, _FIELDS[panel.name], scene.store.instances.room_names)


VIEW = RoomsView()
