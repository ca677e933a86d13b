"""An instance as numbers: scales, pictures with heat on them, and the table of poses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from s2rtui.canvas.colour import NO_DEPTH, Pixels, depth_tint, diverging, mix, turbo
from s2rtui.canvas.raster import resample
from s2rtui.charts.shared.axis_scale import percentile_range, widened
from s2rtui.charts.shared.inputs import Floats, InstanceInput, Interval, SideView


@dataclass(frozen=True, slots=True)
class PoseLine:
    """A line of the table: texts of x, y (m), heading (degrees) and, of predictions, errors."""

    role: str
    cells: tuple[str, str, str, str, str]


@dataclass(frozen=True, slots=True)
class InstanceModel:
    """The scales that both sides share, the heat's name, and the table.

    `heat_range` is None where there is no heat; a signed one is symmetric about 0.
    """

    heat_range: Interval | None
    depth_range: Interval | None
    heat_name: str
    poses: tuple[PoseLine, ...]


HEADINGS = ("x m", "y m", "deg", "err m", "deg")


def instance_model(view: InstanceInput) -> InstanceModel:
    """Common scales of both sides, so that their colours can be compared."""
    name = " ".join(part for part in (view.kind, view.mode) if part)
    return InstanceModel(_heat_range(view), _depth_range(view), name, _poses(view))


def _heat_range(view: InstanceInput) -> Interval | None:
    maps = [side.heat.ravel() for side in (view.sim, view.real) if side.heat is not None]
    values = np.concatenate(maps).astype(np.float64) if maps else np.zeros(0)
    values = values[np.isfinite(values)]
    if not values.size:
        return None
    if view.heat_range is not None:
        low, high = view.heat_range
    elif view.signed:
        low, high = -float(np.abs(values).max()), float(np.abs(values).max())
    else:
        low, high = min(0.0, float(values.min())), float(values.max())
    if view.signed:
        bound = widened(0.0, max(abs(low), abs(high)))[1]
        return (-bound, bound)
    return widened(low, high)


def _depth_range(view: InstanceInput) -> Interval | None:
    if view.depth_range is not None:
        return view.depth_range
    maps = [side.depth.ravel() for side in (view.sim, view.real) if side.depth is not None]
    if not maps:
        return None
    return (0.0, percentile_range(np.concatenate(maps), 1, 99)[1])


def _number(value: float, places: int) -> str:
    if not math.isfinite(value):
        return "n/a"
    return f"{round(value, places) + 0.0:.{places}f}"


def _poses(view: InstanceInput) -> tuple[PoseLine, ...]:
    lines = []
    if view.truth is not None:
        x, y, heading = view.truth
        texts = (_number(x, 2), _number(y, 2), _number(math.degrees(heading), 1), "", "")
        lines.append(PoseLine("truth", texts))
    for role, side in (("sim", view.sim), ("real", view.real)):
        if (pose := side.pose) is not None:
            numbers = (
                (pose.x, 2),
                (pose.y, 2),
                (math.degrees(pose.heading), 1),
                (pose.error, 2),
                (math.degrees(pose.heading_error), 1),
            )
            one, two, three, four, five = (_number(value, places) for value, places in numbers)
            lines.append(PoseLine(role, (one, two, three, four, five)))
    return tuple(lines)


def heat_colours(heat: Floats, scale: Interval, signed: bool) -> tuple[Pixels, Floats]:
    """Colours (h, w, 3) and opacity (h, w) of a heatmap: the stronger, the more opaque."""
    low, high = scale
    values = np.asarray(heat, dtype=np.float64)
    if signed:
        share = np.clip(values / high, -1, 1)
        colours = diverging(share, middle=(236, 236, 236))
    else:
        share = np.clip((values - low) / (high - low), 0, 1)
        colours = turbo(share)
    strength = np.nan_to_num(np.abs(share))
    return colours, np.where(np.isfinite(values), 0.78 * strength**0.8, 0.0) * (strength > 0.02)


def panel_pixels(
    side: SideView,
    what: str,
    model: InstanceModel,
    view: InstanceInput,
    shape: tuple[int, int],
    shades: int | None = None,
) -> Pixels:
    """One picture (`what`: "rgb" or "depth") of shape (height, width), heat laid on it if asked.

    Depth has so many `shades`, see `depth_tint`.
    """
    height, width = shape
    if what == "rgb" or side.depth is None or model.depth_range is None:
        same = side.rgb.shape[:2] == shape
        pixels = side.rgb if same else np.rint(resample(side.rgb, *shape)).astype(np.uint8)
    else:
        low, high = model.depth_range
        metres = resample(side.depth, height, width)
        pixels = depth_tint((metres - low) / (high - low), shades)
        pixels[~np.isfinite(metres)] = NO_DEPTH
    if side.heat is None or model.heat_range is None or view.over not in (what, "both"):
        return pixels
    heat = resample(np.asarray(side.heat, dtype=np.float32), height, width)
    colours, opacity = heat_colours(heat, model.heat_range, view.signed)
    return mix(pixels, colours, opacity)
