"""An instance as numbers and images, and its drawing: sim beside real, heat, poses, notes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store
from s2rstore.records import SIDES, Bounds, Side
from s2rtui.canvas import Pixels
from s2rtui.drawing.drawing import ColourBar, Drawing
from s2rtui.drawing.heat_colours import RampName
from s2rtui.drawing.image import Image, ImageValues
from s2rtui.drawing.plot import Ink, Phrase, Plot
from s2rtui.drawing.scale import Floats, Range, Scale, non_empty, percentile_range
from s2rtui.drawing.table import Cell, Column, Row, TableSpec
from s2rtui.session.heatmaps import SIGNED, ray_of, run_range, unit
from s2rtui.session.state import HeatChoice, ImageSettings

SIDE_BY_SIDE = ImageSettings()
Pose = tuple[float, float, float]
"""x, y in metres, heading in radians."""
Kind = Literal["image", "original", "depth"]
"""A row of images; original: the image before translation, without heat."""
_MISSING: dict[Kind, str] = {
    "image": "no image", "original": "not translated", "depth": "no depth",
}  # fmt: skip
_COLUMNS = (Column(""), *(Column(name, right=True, rank=rank) for name, rank in (
    ("x m", 1), ("y m", 1), ("deg", 3), ("err m", 0), ("err °", 2),
)))  # fmt: skip


@dataclass(frozen=True, slots=True)
class PoseNumbers:
    """A predicted pose with its errors: metres and radians, NaN where unknown."""

    x: float
    y: float
    heading: float
    error: float = float("nan")
    heading_error: float = float("nan")


@dataclass(frozen=True, slots=True, eq=False)
class SideView:
    """One side of an instance.

    rgb: (H, W, 3) uint8, (0, 0, 3) for none. depth: (H, W) metres, NaN where invalid. heat: (h, w)
    over the whole image, any resolution, NaN for none. pose: the prediction on this side.
    original: (H, W, 3), the image before translation, None where rgb is not translated. marked:
    (H, W), the pixels of the chosen class of objects, None without any; place: where these are on
    the map in metres, None where unknown.
    """

    rgb: NDArray[np.uint8]
    depth: Floats | None = None
    heat: Floats | None = None
    pose: PoseNumbers | None = None
    title: str = ""
    original: NDArray[np.uint8] | None = None
    marked: NDArray[np.bool_] | None = None
    place: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class InstanceInput:
    """One instance, sim beside real.

    `kind` (and `mode`) name the heat, `signed` makes its scale diverge about 0, `heat_range`
    fixes it (default: from both sides together), `over` is the row of images that the heat
    lies on. `truth`: the pose of the instance, None without poses; `sim_truth`, `real_truth`: that
    of the side's image where it differs. `notes`: further lines, label and value.
    """

    iid: int
    sim: SideView
    real: SideView
    truth: Pose | None = None
    kind: str | None = None
    mode: str | None = None
    unit: str = ""
    signed: bool = False
    heat_range: Range | None = None
    over: Literal["rgb", "depth", "both"] = "rgb"
    depth_range: Range | None = None
    notes: tuple[tuple[str, str], ...] = ()
    sim_truth: Pose | None = None
    real_truth: Pose | None = None

    @property
    def sides(self) -> tuple[tuple[Side, SideView], ...]:
        return (("sim", self.sim), ("real", self.real))

    @property
    def heat_name(self) -> str:
        """Kind and mode of the heat; empty without heat."""
        return " ".join(part for part in (self.kind, self.mode) if part)

    @property
    def truths(self) -> tuple[tuple[str, Pose], ...]:
        """The true poses by label: one, or one of each side where the images differ in pose."""
        if self.truth is None:
            return ()
        if self.sim_truth is None and self.real_truth is None:
            return (("truth", self.truth),)
        return (
            ("sim truth", self.sim_truth or self.truth),
            ("real truth", self.real_truth or self.truth),
        )


def truth_fields(store: Store, run: str, iid: int) -> dict[str, Any]:
    """The fields of `InstanceInput` that hold the true poses of an instance and of its images."""
    columns, record = store.instances, store.displayed_run(run)
    truth = tuple(float(part[iid]) for part in (columns.x, columns.y, columns.heading))
    fields: dict[str, Any] = {"truth": truth}
    for side in SIDES:
        if (domain := record.domain(side)) in store.domains_with_own_poses:
            own = tuple(store.poses(domain)[iid].tolist())
            fields[f"{side}_truth"] = own if own != truth else None
    return fields


def heat_fields(store: Store, run: str, heat: HeatChoice | None) -> dict[str, Any]:
    """The fields of `InstanceInput` that describe a heat; none without heat."""
    if heat is None:
        return {}
    row = "both" if heat.mode == "rgbd" else "depth" if ray_of(heat) == "depth" else "rgb"
    return {
        "kind": heat.kind.replace("_", " "), "mode": heat.mode, "unit": unit(store, run, heat),
        "signed": heat.kind in SIGNED, "heat_range": run_range(store, run, heat), "over": row,
    }  # fmt: skip


def image_heat_scale(data: InstanceInput) -> Range | None:
    """The scale of the heat of both sides; None without heat."""
    maps = [side.heat for _, side in data.sides if side.heat is not None]
    return common_scale(maps, data.signed, data.heat_range)


def common_scale(maps: Sequence[Floats], signed: bool, heat_range: Range | None) -> Range | None:
    """A scale of heatmaps, by default from all their values; None without any.

    A signed one is symmetric about 0.
    """
    values = np.concatenate([each.ravel() for each in maps]) if maps else np.zeros(0)
    values = values[np.isfinite(values)].astype(np.float64)
    if not values.size:
        return None
    if heat_range is not None:
        low, high = heat_range
    elif signed:
        low, high = -float(np.abs(values).max()), float(np.abs(values).max())
    else:
        low, high = min(0.0, float(values.min())), float(values.max())
    if signed:
        bound = non_empty(0.0, max(abs(low), abs(high)))[1]
        return (-bound, bound)
    return non_empty(low, high)


def depth_scale(data: InstanceInput) -> Range | None:
    """The scale of the depth of both sides in metres; None without depth."""
    if data.depth_range is not None:
        return data.depth_range
    maps = [side.depth.ravel() for _, side in data.sides if side.depth is not None]
    if not maps:
        return None
    return (0.0, percentile_range(np.concatenate(maps), 1, 99)[1])


def overlay_ramp(signed: bool) -> RampName:
    return "signed overlay" if signed else "overlay"


def images(
    data: InstanceInput, kind: Kind, heat: Range | None, depth: Range | None
) -> dict[Side, Image]:
    """The images of a row with their heat, on scales that are common to both sides."""
    over = "depth" if kind == "depth" else "rgb" if kind == "image" else ""
    found: dict[Side, Image] = {}
    for role, side in data.sides:
        ground: Pixels | ImageValues | None = side.rgb if side.rgb.size else None
        if kind == "original":
            ground = side.original
        elif kind == "depth":
            ground = None
            if side.depth is not None and depth is not None:
                ground = ImageValues(side.depth, depth, "depth")
        overlay = None
        if side.heat is not None and heat is not None and data.over in (over, "both"):
            overlay = ImageValues(side.heat, heat, overlay_ramp(data.signed), "heat")
        label = kind if kind == "original" and ground is not None else ""
        found[role] = Image(ground, overlay, _MISSING[kind], label, side.marked)
    return found


def image_shape(data: InstanceInput) -> tuple[float, float]:
    """Width and height of the images as shares of the height."""
    height, width = (data.sim if data.sim.rgb.size else data.real).rgb.shape[:2]
    return (width / height, 1.0) if height and width else (1.0, 1.0)


def instance_drawing(
    data: InstanceInput, settings: ImageSettings = SIDE_BY_SIDE, area: Bounds | None = None
) -> Drawing:
    """The images in rows, their colour bars, the table of poses and the notes.

    settings: how both sides are arranged. area: the shown part, in units of the image's height.
    """
    heat, depth = image_heat_scale(data), depth_scale(data)
    shown: dict[Kind, bool] = {
        "image": any(side.rgb.size for _, side in data.sides),
        "original": any(side.original is not None for _, side in data.sides),
        "depth": depth is not None,
    }
    width, height = image_shape(data)
    shown_area = area or Bounds(0.0, 0.0, width, height)
    x = Scale(shown_area.x0, shown_area.x1)
    cut = None if area is None else (area.x0 / width, area.y0, area.x1 / width, area.y1)
    plots = []
    kind: Kind
    for kind in (kind for kind, is_shown in shown.items() if is_shown):
        y = Scale(shown_area.y1, shown_area.y0, (kind,))
        found = images(data, kind, heat, depth)
        if cut is not None:
            found = {role: image.part(cut) for role, image in found.items()}
        for role, image in _arranged(found, settings).items():
            side = data.sim if role == "sim" else data.real
            if data.truth is None and not side.rgb.size and shown["image"]:
                continue  # without a pose an instance may be imaged on one side alone
            title = (side.title or role) if kind == "image" else kind
            phrases = [Phrase(title, role, role)]
            if kind == "image" and settings.arrangement == "slide":
                phrases.append(Phrase(data.real.title or "real", "real", "real"))
            plots.append(Plot(x, y, (image,), f"{role} {kind}", tuple(phrases)))
    bars: list[ColourBar] = []
    if heat is not None:
        name, ramp = data.heat_name or "heat", overlay_ramp(data.signed)
        bars.append(ColourBar(name, data.unit, heat, data.heat_range is not None, ramp))
    if depth is not None:
        bars.append(ColourBar("depth", "m", depth, ramp="depth"))
    rows = tuple(pose_rows(data))
    table = TableSpec((replace(_COLUMNS[0], name=f"#{data.iid}"), *_COLUMNS[1:]), rows)
    notes = [f"{name} {value}" for name, value in data.notes]
    return Drawing(tuple(plots), table if rows else None, (tuple(bars), *notes))


def _arranged(found: dict[Side, Image], settings: ImageSettings) -> dict[Side, Image]:
    """The images of a row by the side of their title: both, that in front, or one of both."""
    if settings.arrangement == "beside":
        return found
    if settings.arrangement == "blink":
        return {settings.front: found[settings.front]}
    return {"sim": Image.joined(found["sim"], found["real"], settings.divider)}


def pose_rows(data: InstanceInput) -> Iterator[Row]:
    """Yield the true poses and those that are predicted, with their errors; `n/a`: unknown."""
    for label, (x, y, heading) in data.truths:
        yield _row(label, "truth", (x, y, heading))
    for role, side in data.sides:
        if (pose := side.pose) is not None:
            errors = pose.error, pose.heading_error
            yield _row(role, role, (pose.x, pose.y, pose.heading), errors)


def _row(
    label: str, role: Literal["truth", "sim", "real"], pose: Pose,
    errors: tuple[float, float] | None = None,
) -> Row:  # fmt: skip
    numbers = [(pose[0], 2), (pose[1], 2), (math.degrees(pose[2]), 1)]
    if errors is not None:
        numbers += [(errors[0], 2), (math.degrees(errors[1]), 1)]
    texts = [_number(value, places) for value, places in numbers]
    cells = (Cell(label), *(Cell(text) for text in (*texts, "", "")[:5]))
    inks: dict[int, Ink] = dict.fromkeys((0, 4, 5), role)
    return Row(cells, inks=inks, sign=role)


def _number(value: float, places: int) -> str:
    if not math.isfinite(value):
        return "n/a"
    return f"{round(value, places) + 0.0:.{places}f}"
