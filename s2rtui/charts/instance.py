"""The instance view: images, heat and predictions of one instance on both sides."""

from __future__ import annotations

import math
from dataclasses import replace

from s2rstore.errors import RequestError
from s2rstore.records import Bounds
from s2rtui.canvas import Canvas, PlotArea, Point, RenderOptions, Size, Theme
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.instance import image_shape, instance_drawing
from s2rtui.charts.view import Pixels, Table, View
from s2rtui.drawing.cells import draw_cells
from s2rtui.drawing.drawing import Drawing
from s2rtui.session import images
from s2rtui.session.provenance import instance_provenance
from s2rtui.session.session import Session
from s2rtui.session.view_settings import ZoomPlane

_TEXT_ROWS = 16
"""Rows of titles, colour bars, poses and notes."""


class InstanceView(View):
    name = "instance"
    needs_run = False
    key = "3"
    description = "one instance: pictures, heat, poses, errors, ranks, neighbours"
    counts_instances = False
    loads = ("pictures",)
    single_instance = True
    brushable = False
    needs_poses = False
    figure_size = (1600, 1200)

    def subtitle(self, scene: Scene) -> str:
        """The source of the images; long titles are cut."""
        state, resources = scene.state, scene.loaded
        if state.cursor is None:
            return "none"
        requested = instance_provenance(state).label(state)
        failed = resources.failed.get("pictures")
        if resources.pictures is None or resources.pictures_source is None:
            return f"{requested}: {failed}" if failed else f"{requested}, loading"
        present = resources.pictures_source.label(state)
        if present == requested:
            return present
        return f"{present} ({requested}: {failed})" if failed else present

    def loading(self, scene: Scene) -> str:
        """By what the images being loaded differ from those that are shown."""
        shown = scene.loaded.pictures_source
        if shown is None or "pictures" in scene.loaded.failed or scene.state.cursor is None:
            return ""
        return instance_provenance(scene.state).difference(shown)

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        shown = scene.loaded.pictures
        remark = scene.remark(shown.iid) if shown else ""
        state = scene.state
        settings = state.images.arrangement, state.images.front, state.images.divider
        return shown, state.cursor is None, remark, *settings, state.viewport_of(self.name)

    def numbers(self, scene: Scene) -> Table:
        names = ("what", "x_m", "y_m", "heading_deg", "error_m", "heading_error_deg", "note")
        shown = scene.loaded.pictures
        if shown is None:
            return names, []
        rows: list[tuple[object, ...]] = []
        for label, (x, y, heading) in shown.truths:
            rows.append((label, x, y, math.degrees(heading), None, None, None))
        for role, side in shown.sides:
            if (pose := side.pose) is not None:
                turns = math.degrees(pose.heading), math.degrees(pose.heading_error)
                rows.append((role, pose.x, pose.y, turns[0], pose.error, turns[1], None))
        notes = [*shown.notes, ("remark", scene.remark(shown.iid))]
        return names, rows + [(name, *[None] * 5, text) for name, text in notes if text]

    def summary(self, scene: Scene) -> str:
        shown = scene.loaded.pictures
        if shown is None:
            return "No instance."
        sides = [
            f"{role} error {side.pose.error:.2f} m and {math.degrees(side.pose.heading_error):.1f} "
            "degrees"
            for role, side in shown.sides
            if side.pose is not None
        ]
        notes = dict(shown.notes)
        where = "; ".join(notes[name] for name in ("where", "split") if name in notes)
        if not scene.store.has_poses:
            sides = [
                f"image in {view.title or role}" for role, view in shown.sides if view.rgb.size
            ]
        return f"Instance {shown.iid} ({where}): {', '.join(sides) or 'not predicted'}."

    def height(self, scene: Scene, width: int) -> int:
        """The rows in which two images fill the width, with the numbers below."""
        dataset = scene.store.dataset
        share = dataset.frame_height / max(1, dataset.frame_width)
        kinds = 1 + any(domain.has_depth for domain in scene.store.domains.values())
        return kinds * math.ceil(width / 2 * share / 2) + _TEXT_ROWS

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        shown = scene.loaded.pictures
        if shown is None or scene.state.cursor is None:
            return Drawing()
        if remark := scene.remark(shown.iid):
            shown = replace(shown, notes=(("remark", remark), *shown.notes))
        return instance_drawing(shown, scene.state.images, scene.state.viewport_of(self.name))

    def zoom_plane(self, scene: Scene) -> ZoomPlane | None:
        shown = scene.loaded.pictures
        width, height = (1.0, 1.0) if shown is None else image_shape(shown)
        return ZoomPlane(self.name, Bounds(0.0, 0.0, width, height), True, inside=True)

    def drag(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> bool:
        """Move the divider between both sides, if there is one."""
        if scene.state.images.arrangement == "slide":
            share = (panel.to_cells(*point)[0] - panel.x) / panel.width
            session.dispatch(images.place_divider, share)
        return True

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        return draw_cells(self.drawing(scene, size[0]), size, options)

    def heading(self, scene: Scene) -> tuple[str, str]:
        shown = scene.loaded.pictures
        if shown is None:
            return scene.title, ""
        split = dict(shown.notes).get("split", "")
        title = f"{scene.title}: instance {shown.iid}{f' ({split})' if split else ''}"
        return title, shown.heat_name and f"heat: {shown.heat_name}"

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        shown = scene.loaded.pictures
        if shown is None:
            raise RequestError("--select: selects nothing, so there is no instance to draw")
        if not any(side.rgb.size for _, side in shown.sides):
            reason = "this store has no frames to draw; `s2r show` prints the numbers"
            raise RequestError(f"--view instance: {reason}")
        return super().figure(scene, size, theme)


VIEW = InstanceView()
