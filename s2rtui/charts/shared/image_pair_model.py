"""The inputs and numbers of an instance's drawing: scales, images with heat, table of poses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtui.canvas import Pixels, mix, turbo
from s2rtui.canvas.colour import NO_DEPTH, depth_tint
from s2rtui.canvas.raster import resample
from s2rtui.drawing.heat_colours import Ramp, heat_colours
from s2rtui.drawing.scale import Floats, Interval, non_empty, percentile_range
from s2rtui.session.heatmaps import SIGNED, ray_of, run_range, unit
from s2rtui.session.state import HeatChoice

Pose = tuple[float, float, float]
"""x, y in metres, heading in radians."""
"""Colours of fractions 0 .. 1 of a scale."""


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
    original: (H, W, 3), the image before translation, None where rgb is not translated.
    """

    rgb: NDArray[np.uint8]
    depth: Floats | None = None
    heat: Floats | None = None
    pose: PoseNumbers | None = None
    title: str = ""
    original: NDArray[np.uint8] | None = None


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
    heat_range: Interval | None = None
    over: Literal["rgb", "depth", "both"] = "rgb"
    depth_range: Interval | None = None
    notes: tuple[tuple[str, str], ...] = ()
    sim_truth: Pose | None = None
    real_truth: Pose | None = None

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


@dataclass(frozen=True, slots=True)
class PoseLine:
    """A row of the table: x, y (m), heading (degrees); for predictions also their errors."""

    role: str
    label: str
    cells: tuple[str, str, str, str, str]


@dataclass(frozen=True, slots=True)
class InstanceModel:
    """The scales of both sides, the heat's name, and the table.

    `heat_range` is None without heat; a signed one is symmetric about 0.
    """

    heat_range: Interval | None
    depth_range: Interval | None
    heat_name: str
    poses: tuple[PoseLine, ...]


HEADINGS = ("x m", "y m", "deg", "err m", "deg")


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


def instance_model(data: InstanceInput) -> InstanceModel:
    """Compute scales common to both sides, so that colours can be compared."""
    name = " ".join(part for part in (data.kind, data.mode) if part)
    return InstanceModel(_heat_range(data), _depth_range(data), name, _poses(data))


def _heat_range(data: InstanceInput) -> Interval | None:
    maps = [side.heat.ravel() for side in (data.sim, data.real) if side.heat is not None]
    values = np.concatenate(maps).astype(np.float64) if maps else np.zeros(0)
    values = values[np.isfinite(values)]
    if not values.size:
        return None
    if data.heat_range is not None:
        low, high = data.heat_range
    elif data.signed:
        low, high = -float(np.abs(values).max()), float(np.abs(values).max())
    else:
        low, high = min(0.0, float(values.min())), float(values.max())
    if data.signed:
        bound = non_empty(0.0, max(abs(low), abs(high)))[1]
        return (-bound, bound)
    return non_empty(low, high)


def _depth_range(data: InstanceInput) -> Interval | None:
    if data.depth_range is not None:
        return data.depth_range
    maps = [side.depth.ravel() for side in (data.sim, data.real) if side.depth is not None]
    if not maps:
        return None
    return (0.0, percentile_range(np.concatenate(maps), 1, 99)[1])


def _number(value: float, places: int) -> str:
    if not math.isfinite(value):
        return "n/a"
    return f"{round(value, places) + 0.0:.{places}f}"


def _poses(data: InstanceInput) -> tuple[PoseLine, ...]:
    lines = []
    for label, (x, y, heading) in data.truths:
        texts = (_number(x, 2), _number(y, 2), _number(math.degrees(heading), 1), "", "")
        lines.append(PoseLine("truth", label, texts))
    for role, side in (("sim", data.sim), ("real", data.real)):
        if (pose := side.pose) is not None:
            numbers = (
                (pose.x, 2),
                (pose.y, 2),
                (math.degrees(pose.heading), 1),
                (pose.error, 2),
                (math.degrees(pose.heading_error), 1),
            )
            one, two, three, four, five = (_number(value, places) for value, places in numbers)
            lines.append(PoseLine(role, role, (one, two, three, four, five)))
    return tuple(lines)


def panel_pixels(
    side: SideView,
    what: str,
    model: InstanceModel,
    data: InstanceInput,
    shape: tuple[int, int],
    shades: int | None = None,
    unsigned_colours: Ramp = turbo,
) -> Pixels:
    """An image of shape (height, width), with heat if it has any.

    `what` is "rgb", "depth" or "original": the image before translation, without heat.

    `shades` limits the greys of depth, see `depth_tint`.
    """
    height, width = shape
    if what == "original" and side.original is not None:
        return np.rint(resample(side.original, *shape)).astype(np.uint8)
    if what == "rgb" or side.depth is None or model.depth_range is None:
        unchanged = side.rgb.shape[:2] == shape
        pixels = side.rgb if unchanged else np.rint(resample(side.rgb, *shape)).astype(np.uint8)
    else:
        low, high = model.depth_range
        metres = resample(side.depth, height, width)
        pixels = depth_tint((metres - low) / (high - low), shades)
        pixels[~np.isfinite(metres)] = NO_DEPTH
    if side.heat is None or model.heat_range is None or data.over not in (what, "both"):
        return pixels
    heat = resample(np.asarray(side.heat, dtype=np.float32), height, width)
    colours, opacity = heat_colours(heat, model.heat_range, data.signed, unsigned_colours)
    return mix(pixels, colours, opacity)
