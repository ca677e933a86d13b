"""The worst instances of a selection in a report: images, poses, errors, tags and note."""

from __future__ import annotations

import math
from dataclasses import replace

from s2rstore.index.population import Population
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.instance import InstanceInput, Kind, depth_scale, image_heat_scale, images
from s2rtui.charts.shared.instance_input import instance_input
from s2rtui.drawing.scale import short_number
from s2rtui.export.report.data_uri_images import image
from s2rtui.export.report.metric_tables import number
from s2rtui.export.report.report_model import Example, ReportImage, ReportTable
from s2rtui.session import instance_list
from s2rtui.session.state import HeatChoice
from s2rtui.user_data.notebook import Remark

WORST_COUNT = 3
_ZERO_SHARE = 0.005
"""Share of the upper end of a scale below which its lower end is printed as 0."""


def worst_instances(scene: Scene, heat: HeatChoice | None) -> list[Example]:
    """Return the selected instances with the largest real errors; `heat` overlays their images."""
    by_error = replace(scene.state, sort="real.error", descending=True)
    examples = []
    for iid in instance_list.order(scene.store, by_error, scene.notes)[:WORST_COUNT].tolist():
        instance = instance_input(
            scene.store,
            scene.state.run,
            iid,
            heat,
            Population(with_trained=scene.state.with_trained),
        )
        facts = *instance.notes, ("select", f"ids({iid})")
        remark = scene.notes.remarks.get(iid, Remark())
        content = _pose_table(instance), facts, _images(instance)
        examples.append(Example(iid, *content, remark.tags, remark.note))
    return examples


def _pose_table(instance: InstanceInput) -> ReportTable:
    names = ("", "x", "y", "heading", "error", "heading error")
    rows = []
    for label, pose in instance.truths:
        rows.append((label, *_pose(*pose), "", ""))
    for role, side in instance.sides:
        if (shown := side.pose) is not None:
            errors = number(shown.error, 2, "m"), number(math.degrees(shown.heading_error), 1, "°")
            rows.append((role, *_pose(shown.x, shown.y, shown.heading), *errors))
    return ReportTable(f"Poses of instance {instance.iid}", names, rows)


def _pose(x: float, y: float, heading: float) -> tuple[str, str, str]:
    return number(x, 2, "m"), number(y, 2, "m"), number(math.degrees(heading), 1, "°")


def _images(instance: InstanceInput) -> list[ReportImage]:
    heat, depth = image_heat_scale(instance), depth_scale(instance)
    scale = ""
    if heat is not None:
        low, high = heat
        low = low if abs(low) > _ZERO_SHARE * abs(high) else 0.0
        span = f"{short_number(low, 2)} to {short_number(high, 2)}"
        scale = f", {instance.heat_name} {span} {instance.unit}".rstrip()
    found: list[ReportImage] = []
    kinds: tuple[Kind, ...] = ("image", "depth")
    for kind in kinds:
        for role, shown in images(instance, kind, heat, depth).items():
            side = instance.sim if role == "sim" else instance.real
            if shown.shape is None or not side.rgb.size:
                continue
            caption = f"{side.title or role}, {kind}"
            if kind == "depth" and depth is not None:
                caption += f" 0 to {short_number(depth[1], 2)} m"
            if shown.overlay is not None:
                caption += scale
            error = f", position error {side.pose.error:.2f} m" if side.pose is not None else ""
            alt = f"Instance {instance.iid}: {role} {kind}{error}"
            pixels = shown.pixels(side.rgb.shape[:2])
            found.append(image(pixels, alt, caption))
    return found
