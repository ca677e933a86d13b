"""One instance: what the model saw on both sides, and what it said."""

from __future__ import annotations

from s2rtui import plots
from s2rtui.canvas import Canvas, Look, Size
from s2rtui.views.contract import Scene, Table, View


class InstanceView(View):
    name = "instance"
    key = "3"
    description = "one instance: pictures, heat, poses, errors, ranks, neighbours"

    def told(self, scene: Scene) -> str:
        state, pictures = scene.state, scene.resources.pictures
        if state.cursor is None:
            return "none"
        label = f"{state.cursor}" + (f", {state.heat.label}" if state.heat else "")
        if pictures is None:
            return f"{label}, loading"
        return label if pictures.iid == state.cursor else f"{label} (pictures of {pictures.iid})"

    def depends(self, scene: Scene) -> tuple[object, ...]:
        return (scene.resources.pictures,)

    def numbers(self, scene: Scene) -> Table:
        names = ("what", "x", "y", "heading", "error", "heading error")
        shown = scene.resources.pictures
        if shown is None:
            return names, []
        model = plots.instance_model(shown)
        rows: list[tuple[object, ...]] = [(line.role, *line.cells) for line in model.poses]
        return names, rows + [(name, value, "", "", "", "") for name, value in shown.notes]

    def draw(self, scene: Scene, size: Size, look: Look) -> Canvas:
        if scene.resources.pictures is None or scene.state.cursor is None:
            return Canvas(*size, theme=look.theme)
        return plots.instance(scene.resources.pictures, size, look)
