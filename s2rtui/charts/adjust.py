"""The adjust view: sliders, and below them the adjusted images with their predictions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from s2rstore.reader import Store
from s2rstore.records import Side
from s2rtui.canvas import Canvas, PlotArea, Point, RenderOptions, Size
from s2rtui.canvas.fit_text import wrap_text
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.instance import (
    InstanceInput,
    PoseNumbers,
    SideView,
    heat_fields,
    instance_drawing,
    truth_fields,
)
from s2rtui.charts.view import View
from s2rtui.drawing.cells import draw_cells, drawing_panels
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.plot import Ink
from s2rtui.drawing.scale import Scale, short_number
from s2rtui.drawing.table import Cell, Column, Dot, Row, Span, StripMark, TableSpec
from s2rtui.session import adjusting
from s2rtui.session.session import Session
from s2rtui.session.state import Adjust, HeatChoice, Slider, State

if TYPE_CHECKING:
    from s2rtools.interactive import LiveResult
_IMAGE_ROWS = 18
"""Screen rows that the images and the table of errors need."""


def live_input(
    store: Store, state: State, result: LiveResult, heat: HeatChoice | None
) -> InstanceInput:
    """Images and predictions of a live result, with the change of the stored errors."""
    iid = result.iid
    return InstanceInput(
        iid=iid,
        sim=_side(result, "sim", heat),
        real=_side(result, "real", heat),
        **truth_fields(store, state.run, iid),
        **heat_fields(store, state.run, heat),
        notes=(_change(store, state, result, "sim"), _change(store, state, result, "real")),
    )


def _side(result: LiveResult, side: Side, heat: HeatChoice | None) -> SideView:
    shown = result.side(side)
    return SideView(
        rgb=shown.rgb,
        depth=shown.depth,
        heat=None if heat is None else result.heatmap(heat.kind, side, heat.mode),
        pose=None
        if math.isnan(shown.x)
        else PoseNumbers(shown.x, shown.y, shown.heading, shown.error, shown.heading_error),
        original=shown.original,
    )


def _change(store: Store, state: State, result: LiveResult, side: Side) -> tuple[str, str]:
    """The error of the stored run, the adjusted one, and their difference."""
    before = float(store.run_columns(state.run).side(side).error[result.iid])
    after = result.side(side).error
    if not (math.isfinite(before) and math.isfinite(after)):
        return side, "no prediction"
    return side, f"error {before:.2f} m, now {after:.2f} m ({after - before:+.2f})"


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

    def sliders(self, scene: Scene) -> Drawing:
        """A row per slider with its range, neutral value and value."""
        adjust = scene.state.adjust or Adjust("")
        values = [adjust.value(slider.key) for slider in adjust.sliders]
        return sliders_drawing(adjust.sliders, values, adjust.active)

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        resources = scene.loaded
        return scene.state.adjust, resources.adjusted(scene.state), resources.failed.get("live")

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        canvas = Canvas(*size, options)
        adjust = scene.state.adjust
        if adjust is None or adjust.missing:
            _put_message(canvas, adjust.missing if adjust else "no instance to adjust", 0)
            return canvas
        rows = self._rows(scene, canvas.height)
        canvas.paste(draw_cells(self.sliders(scene), (canvas.width, rows), options), 0, 0)
        used = rows
        if adjust.reason and canvas.height > rows + 2:
            used += _put_message(canvas, adjust.reason, rows)
        space = canvas.height - used - 1
        if failed := scene.loaded.failed.get("live"):
            _put_message(canvas, failed, used + 1)
            return canvas
        live = scene.loaded.adjusted(scene.state)
        if live is not None and space > 0:
            images = draw_cells(instance_drawing(live), (canvas.width, space), options)
            canvas.paste(images, 0, used + 1)
        return canvas

    def _rows(self, scene: Scene, height: int) -> int:
        """Number of rows of sliders: at most half of the height, less where the errors below them
        would not fit, but at least a third."""
        most = max(height // 3, min(height // 2, height - _IMAGE_ROWS))
        count = len(scene.state.adjust.sliders) if scene.state.adjust else 0
        return max(1, min(count, most))

    def panels(self, scene: Scene, size: Size, options: RenderOptions) -> Sequence[PlotArea]:
        return drawing_panels(self.sliders(scene), (size[0], self._rows(scene, size[1])), options)

    def click(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> None:
        adjust, number = scene.state.adjust, int(panel.name)
        if adjust is not None:
            low, high = adjust.sliders[number].lowest, adjust.sliders[number].highest
            # the middles of the outer cells are the lowest and the highest value
            share = (point[0] * panel.width - 0.5) / max(1, panel.width - 1)
            session.dispatch(adjusting.set_slider, number, low + share * (high - low))

    def drag(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> bool:
        self.click(session, scene, panel, point)
        return True


VIEW = AdjustView()


def sliders_drawing(sliders: Sequence[Slider], values: Sequence[float], active: int) -> Drawing:
    """A row per slider; its strip is the range from the lowest value, 0, to the highest, 1."""
    columns = Column(""), Column("", scale=Scale(0.0, 1.0)), Column("", rank=0)
    rows = []
    for number, (slider, value) in enumerate(zip(sliders, values, strict=True)):
        span = max(slider.highest - slider.lowest, 1e-12)
        neutral, here = ((each - slider.lowest) / span for each in (slider.neutral, value))
        moved = value != slider.neutral
        ink: Ink = slider.side if moved else "text"
        strip: tuple[StripMark, ...] = (
            Span(0.0, 1.0, "faint"), Span(min(neutral, here), max(neutral, here), slider.side),
            Dot(neutral, "muted", "vertical"), Dot(here, ink, "selected"),
        )  # fmt: skip
        text = f"{short_number(value)} {slider.unit}".rstrip()
        cells = Cell(_label(slider.name), slider.side), Cell(strip=strip), Cell(text)
        inks: dict[int, Ink] = {0: slider.side, 2: "text" if moved else "muted"}
        rows.append(Row(cells, inks=inks, name=str(number)))
    return Drawing(table=TableSpec(columns, tuple(rows), chosen=active))


def _label(name: str) -> str:
    """The name of a translator as it is, other names with spaces."""
    kind, colon, translator = name.partition(":")
    return translator if colon else kind.replace("_", " ")


def _put_message(canvas: Canvas, text: str, top: int) -> int:
    """Write a wrapped text from row `top` on. Returns the number of its rows."""
    lines = wrap_text(text, max(8, canvas.width))
    for row, line in enumerate(lines, top):
        if row < canvas.height:
            canvas.text(0, row, line, canvas.theme.muted)
    return len(lines)
