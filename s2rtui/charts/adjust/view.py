"""Adjusting live: sliders, and under them what the model sees and says with them."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from s2rtui.canvas import Canvas, RenderOptions, Size
from s2rtui.canvas.brush_surface import Panel, Point
from s2rtui.charts.adjust.terminal import SliderLine, sliders, sliders_surface
from s2rtui.charts.instance import terminal
from s2rtui.charts.view import Scene, View
from s2rtui.session import Session, adjusting
from s2rtui.session.state import Adjust


class AdjustView(View):
    name = "adjust"
    key = "a"
    description = "adjust images live, and save that as a run"
    stored = False
    marked = False

    def told(self, scene: Scene) -> str:
        state = scene.state
        adjust = state.adjust
        if adjust is None or adjust.missing:
            return ""
        if "live" in scene.resources.failed:
            return f"run {adjust.run}: not adjusted"
        live = scene.resources.adjusted(state)
        if live is not None:
            later = f" (loading {state.cursor})" if live.iid != state.cursor else ""
            return f"run {adjust.run}, instance {live.iid}{later}"
        return f"run {adjust.run}: loading the model"

    def lines(self, scene: Scene) -> tuple[SliderLine, ...]:
        adjust = scene.state.adjust or Adjust("")
        return tuple(
            SliderLine(
                slider.name.replace("_", " "), slider.side, slider.lowest, slider.highest,
                slider.neutral, adjust.value(slider.key), slider.unit, index == adjust.active,
            )
            for index, slider in enumerate(adjust.sliders)
        )  # fmt: skip

    def depends(self, scene: Scene) -> tuple[object, ...]:
        resources = scene.resources
        return scene.state.adjust, resources.adjusted(scene.state), resources.failed.get("live")

    def draw(self, scene: Scene, size: Size, look: RenderOptions) -> Canvas:
        canvas = Canvas(*size, theme=look.theme)
        adjust = scene.state.adjust
        if adjust is None or adjust.missing:
            return _written(canvas, adjust.missing if adjust else "no instance to adjust", 0)
        lines = self.lines(scene)
        rows = self._rows(scene, canvas.height)
        canvas.paste(sliders(lines, (canvas.width, rows), look), 0, 0)
        used = rows
        if adjust.reason and canvas.height > rows + 2:
            canvas.text(0, rows, adjust.reason[: canvas.width], look.theme.muted)
            used += 1
        space = canvas.height - used - 1
        if failed := scene.resources.failed.get("live"):
            return _written(canvas, failed, used + 1)
        live = scene.resources.adjusted(scene.state)
        if live is not None and space > 0:
            canvas.paste(terminal.instance(live, (canvas.width, space), look), 0, used + 1)
        return canvas

    def _rows(self, scene: Scene, height: int) -> int:
        """The sliders, as long as the pictures keep most of the room."""
        return max(1, min(len(self.lines(scene)), height // 2))

    def surface(self, scene: Scene, size: Size, look: RenderOptions) -> Sequence[Panel]:
        lines = self.lines(scene)
        return sliders_surface(lines, (size[0], self._rows(scene, size[1]))) if lines else ()

    def press(self, session: Session, scene: Scene, panel: Panel, point: Point) -> None:
        session.dispatch(adjusting.set_slider, int(panel.name), point[0])

    def drag(self, session: Session, scene: Scene, panel: Panel, point: Point) -> bool:
        session.dispatch(adjusting.set_slider, int(panel.name), point[0])
        return True


def _written(canvas: Canvas, text: str, top: int) -> Canvas:
    """Words across the canvas, from a row on."""
    for row, line in enumerate(textwrap.wrap(text, max(8, canvas.width)), top):
        if row < canvas.height:
            canvas.text(0, row, line, canvas.theme.muted)
    return canvas
