"""The adjust view: sliders, and below them the adjusted images with their predictions."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from s2rtui.canvas import Canvas, PlotArea, Point, RenderOptions, Size
from s2rtui.charts.adjust.terminal import SliderLine, draw_sliders, slider_panels
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared import image_pair_terminal
from s2rtui.charts.view import View
from s2rtui.session import Session, adjusting
from s2rtui.session.state import Adjust

_IMAGE_ROWS = 16
"""Screen rows that the images and the table of errors need."""


class AdjustView(View):
    name = "adjust"
    key = "a"
    description = "adjust images live, and save that as a run"
    counts_instances = False
    from_store = False
    brushable = False

    def subtitle(self, scene: Scene) -> str:
        state = scene.state
        adjust = state.adjust
        if adjust is None or adjust.missing:
            return ""
        if "live" in scene.loaded.failed:
            return f"run {adjust.run}: not adjusted"
        live = scene.loaded.adjusted(state)
        if live is not None:
            loading = f" (loading {state.cursor})" if live.iid != state.cursor else ""
            return f"run {adjust.run}, instance {live.iid}{loading}"
        return f"run {adjust.run}: loading the model"

    def lines(self, scene: Scene) -> tuple[SliderLine, ...]:
        adjust = scene.state.adjust or Adjust("")
        return tuple(
            SliderLine(
                _label(slider.name), slider.side,
                slider.lowest, slider.highest, slider.neutral, adjust.value(slider.key),
                slider.unit, index == adjust.active,
            )
            for index, slider in enumerate(adjust.sliders)
        )  # fmt: skip

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        resources = scene.loaded
        return scene.state.adjust, resources.adjusted(scene.state), resources.failed.get("live")

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        canvas = Canvas(*size, options)
        adjust = scene.state.adjust
        if adjust is None or adjust.missing:
            return _put_message(canvas, adjust.missing if adjust else "no instance to adjust", 0)
        lines = self.lines(scene)
        rows = self._rows(scene, canvas.height)
        canvas.paste(draw_sliders(lines, (canvas.width, rows), options), 0, 0)
        used = rows
        if adjust.reason and canvas.height > rows + 2:
            canvas.text(0, rows, adjust.reason[: canvas.width], options.theme.muted)
            used += 1
        space = canvas.height - used - 1
        if failed := scene.loaded.failed.get("live"):
            return _put_message(canvas, failed, used + 1)
        live = scene.loaded.adjusted(scene.state)
        if live is not None and space > 0:
            canvas.paste(
                image_pair_terminal.draw_instance(live, (canvas.width, space), options), 0, used + 1
            )
        return canvas

    def _rows(self, scene: Scene, height: int) -> int:
        """Number of rows of sliders: at most half of the height, less where the errors below them
        would not fit, but at least a third."""
        most = max(height // 3, min(height // 2, height - _IMAGE_ROWS))
        return max(1, min(len(self.lines(scene)), most))

    def panels(self, scene: Scene, size: Size, options: RenderOptions) -> Sequence[PlotArea]:
        lines = self.lines(scene)
        return slider_panels(lines, (size[0], self._rows(scene, size[1]))) if lines else ()

    def click(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> None:
        session.dispatch(adjusting.set_slider, int(panel.name), point[0])

    def drag(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> bool:
        session.dispatch(adjusting.set_slider, int(panel.name), point[0])
        return True


VIEW = AdjustView()


def _label(name: str) -> str:
    """The name of a translator as it is, other names with spaces."""
    kind, colon, translator = name.partition(":")
    return translator if colon else kind.replace("_", " ")


def _put_message(canvas: Canvas, text: str, top: int) -> Canvas:
    """Write a wrapped text from row `top` on."""
    for row, line in enumerate(textwrap.wrap(text, max(8, canvas.width)), top):
        if row < canvas.height:
            canvas.text(0, row, line, canvas.theme.muted)
    return canvas
