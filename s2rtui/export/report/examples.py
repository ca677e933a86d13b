"""Single instances of a report: images, poses, errors, and what the user wrote."""

from __future__ import annotations

import math
from dataclasses import replace

from s2rtui.charts.instance.model import instance_input
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.axis_scale import short_number
from s2rtui.charts.shared.instance_model import (
    InstanceInput,
    InstanceModel,
    SideView,
    instance_model,
    panel_pixels,
)
from s2rtui.export.report.content import Example, ReportImage, ReportTable
from s2rtui.export.report.data_uri_images import image
from s2rtui.export.report.tables import number
from s2rtui.session import HeatChoice, State, instance_list
from s2rtui.user_data.notebook import Remark

WORST = 3
_NOTHING = 0.005
"""The share of a scale's upper end under which its lower end is 0."""


def worst(scene: Scene, heat: HeatChoice | None) -> list[Example]:
    """The selection's three largest real errors; `heat` lies on their images."""
    rows = instance_list.order(scene.store, _by_error(scene.state), scene.notes)[:WORST].tolist()
    return [_example(scene, int(iid), heat) for iid in rows]


def _by_error(state: State) -> State:
    return replace(state, sort="real.error", descending=True)


def _example(scene: Scene, iid: int, heat: HeatChoice | None) -> Example:
    shown = instance_input(scene.store, scene.state.run, iid, heat)
    remark = scene.notes.remarks.get(iid, Remark())
    return Example(iid, _poses(shown), shown.notes, _images(shown), remark.tags, remark.note)


def _poses(shown: InstanceInput) -> ReportTable:
    names = ("", "x", "y", "heading", "error", "heading error")
    rows = []
    if shown.truth is not None:
        x, y, heading = shown.truth
        turned = number(math.degrees(heading), 1, "°")
        rows.append(("truth", number(x, 2, "m"), number(y, 2, "m"), turned, "", ""))
    for role, side in (("sim", shown.sim), ("real", shown.real)):
        if (pose := side.pose) is not None:
            rows.append(
                (role, number(pose.x, 2, "m"), number(pose.y, 2, "m"),
                 number(math.degrees(pose.heading), 1, "°"), number(pose.error, 2, "m"),
                 number(math.degrees(pose.heading_error), 1, "°"))
            )  # fmt: skip
    return ReportTable(f"Poses of instance {shown.iid}", names, rows)


def _images(shown: InstanceInput) -> list[ReportImage]:
    model = instance_model(shown)
    scale = ""
    if model.heat_range is not None:
        low, high = model.heat_range
        low = low if abs(low) > _NOTHING * abs(high) else 0.0
        scale = f", {model.heat_name} {short_number(low, 2)} to {short_number(high, 2)} {shown.unit}".rstrip()
    found = []
    for what, word in (("rgb", "image"), ("depth", "depth")):
        for role, side in (("sim", shown.sim), ("real", shown.real)):
            if not side.rgb.size or (what == "depth" and side.depth is None):
                continue
            pixels = panel_pixels(side, what, model, shown, side.rgb.shape[:2])
            hot = scale if side.heat is not None and shown.over in (what, "both") else ""
            caption = f"{side.title or role}, {word}{_metres(model, what)}{hot}"
            found.append(image(pixels, f"Instance {shown.iid}: {_alt(role, side, word)}", caption))
    return found


def _metres(model: InstanceModel, what: str) -> str:
    if what != "depth" or model.depth_range is None:
        return ""
    return f" 0 to {short_number(model.depth_range[1], 2)} m"


def _alt(role: str, side: SideView, word: str) -> str:
    error = f", position error {side.pose.error:.2f} m" if side.pose is not None else ""
    return f"{role} {word}{error}"
