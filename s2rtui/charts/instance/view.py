"""One instance: what the model saw on both sides, and what it said."""

from __future__ import annotations

import math
from dataclasses import replace

from s2rstore.errors import RequestError
from s2rtui.canvas import Canvas, RenderOptions, Size, Theme
from s2rtui.charts.instance import terminal
from s2rtui.charts.view import Pixels, Scene, Table, View
from s2rtui.session.provenance import instance_provenance


class InstanceView(View):
    name = "instance"
    key = "3"
    description = "one instance: pictures, heat, poses, errors, ranks, neighbours"
    feeds = ("pictures",)
    one = True
    paper = (1600, 1200)

    def told(self, scene: Scene) -> str:
        """What the pictures are of comes first; the title may be cut at its end."""
        state, resources = scene.state, scene.resources
        if state.cursor is None:
            return "none"
        wanted = instance_provenance(state).told(state)
        failed = resources.failed.get("pictures")
        if resources.pictures is None or resources.pictures_of is None:
            return f"{wanted}: {failed}" if failed else f"{wanted}, loading"
        present = resources.pictures_of.told(state)
        if present == wanted:
            return present
        return f"{present} ({wanted}: {failed})" if failed else f"{present} (loading {wanted})"

    def depends(self, scene: Scene) -> tuple[object, ...]:
        shown = scene.resources.pictures
        remark = scene.remark(shown.iid) if shown else ""
        return shown, scene.state.cursor is None, remark

    def numbers(self, scene: Scene) -> Table:
        names = ("what", "x", "y", "heading", "error", "heading_error", "note")
        shown = scene.resources.pictures
        if shown is None:
            return names, []
        rows: list[tuple[object, ...]] = []
        if shown.truth is not None:
            x, y, heading = shown.truth
            rows.append(("truth", x, y, math.degrees(heading), None, None, None))
        for role, side in (("sim", shown.sim), ("real", shown.real)):
            if (pose := side.pose) is not None:
                turns = math.degrees(pose.heading), math.degrees(pose.heading_error)
                rows.append((role, pose.x, pose.y, turns[0], pose.error, turns[1], None))
        notes = [*shown.notes, ("remark", scene.remark(shown.iid))]
        return names, rows + [(name, *[None] * 5, told) for name, told in notes if told]

    def words(self, scene: Scene) -> str:
        shown = scene.resources.pictures
        if shown is None:
            return "No instance."
        sides = [
            f"{role} error {side.pose.error:.2f} m and {math.degrees(side.pose.heading_error):.1f} "
            "degrees"
            for role, side in (("sim", shown.sim), ("real", shown.real))
            if side.pose is not None
        ]
        where = dict(shown.notes).get("where", "")
        return f"Instance {shown.iid} ({where}): {', '.join(sides) or 'not predicted'}."

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.instance import paper

        shown = scene.resources.pictures
        if shown is None:
            raise RequestError("--select: selects nothing, so there is no instance to draw")
        if not (shown.sim.rgb.size and shown.real.rgb.size):
            told = "this store has no frames to draw; `s2r show` prints the numbers"
            raise RequestError(f"--view instance: {told}")
        return paper.instance_figure(shown, size, theme, scene.state.run)

    def draw(self, scene: Scene, size: Size, look: RenderOptions) -> Canvas:
        if scene.resources.pictures is None or scene.state.cursor is None:
            return Canvas(*size, theme=look.theme)
        shown = scene.resources.pictures
        if remark := scene.remark(shown.iid):
            shown = replace(shown, notes=(("remark", remark), *shown.notes))
        return terminal.instance(shown, size, look)
