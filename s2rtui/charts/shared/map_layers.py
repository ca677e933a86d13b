"""The ground of a map as numbers: floor plan, heat and what was seen, per pixel of a frame."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds
from s2rtui.analysis.identity_cache import ArrayKey, cached_by_identity
from s2rtui.analysis.map_frame import MapFrame, sample
from s2rtui.canvas.colour import Pixels, Theme, luma, mix, turbo
from s2rtui.charts.shared.axis_scale import fraction, percentile_range
from s2rtui.charts.shared.inputs import Ground, Interval

Layer = NDArray[np.floating]
DIMMED = 0.78
"""How far what was not seen goes towards the background."""


def heat_scale(ground: Ground) -> Interval | None:
    """The heat's range: the given one, or 0 (where nothing is negative) to the 99th percentile."""
    found = _heat_scale(ArrayKey(ground.heat)) if ground.heat is not None else None
    return ground.heat_range or found if found else None


@cached_by_identity(8)
def _heat_scale(heat: ArrayKey) -> Interval | None:
    values = np.asarray(heat.array)
    if not np.isfinite(values).any():
        return None
    low, high = percentile_range(values)
    return (0.0, high) if low >= 0 and high > 0 else (low, high)


def ground_layer(ground: Ground, frame: MapFrame, theme: Theme) -> Pixels:
    """(height, width, 3), read-only: the floor plan paled, heat on it, the unseen dimmed.

    Kept for the last few frames: the arrays are taken as never changed in place.
    """
    arrays = ArrayKey(ground.floor_plan), ArrayKey(ground.heat), ArrayKey(ground.clip)
    return _ground(*arrays, ground.bounds, ground.y_down, heat_scale(ground), frame, theme)


@cached_by_identity(8)
def _ground(
    plan: ArrayKey,
    heat: ArrayKey,
    clip: ArrayKey,
    bounds: Bounds,
    y_down: bool,
    scale: Interval | None,
    frame: MapFrame,
    theme: Theme,
) -> Pixels:
    picture: Any = plan.array
    values: Any = heat.array
    seen_at: Any = clip.array
    ground = Ground(bounds, y_down, picture, values, scale, seen_at)
    layer = _floor(ground, frame, theme)
    shares = heat_layer(ground, frame)
    if shares is not None:
        opacity = 0.12 + 0.74 * np.nan_to_num(shares) ** 0.7
        layer = mix(layer, turbo(shares), np.where(np.isfinite(shares), opacity, 0.0))
    seen = seen_layer(ground, frame)
    if seen is not None:
        layer = mix(layer, np.array(theme.background), DIMMED * (1 - seen))
    layer.setflags(write=False)
    return layer


def _floor(ground: Ground, frame: MapFrame, theme: Theme) -> Pixels:
    base = np.empty((frame.height, frame.width, 3), dtype=np.uint8)
    base[:] = theme.background
    floor = floor_layer(ground, frame)
    if floor is None:
        return base
    seen = np.asarray(np.isfinite(floor).all(axis=-1))
    floor = np.nan_to_num(floor)
    grey = np.repeat((luma(floor) * 255)[..., None], 3, axis=-1)
    share = 0.46 if theme.dark else 0.55
    paled = mix(base, 0.45 * floor + 0.55 * grey, share)
    return np.where(seen[..., None], paled, base).astype(np.uint8)


def floor_layer(ground: Ground, frame: MapFrame) -> Layer | None:
    """The floor plan's colours (height, width, 3), NaN outside of it."""
    if ground.floor_plan is None or _empty(ground.bounds):
        return None
    return _sampled(ArrayKey(ground.floor_plan), ground.bounds, frame, ground.y_down)


def heat_layer(ground: Ground, frame: MapFrame) -> Layer | None:
    """The heat as fractions of its scale (height, width), NaN where nothing is."""
    scale = heat_scale(ground)
    if scale is None or _empty(ground.bounds):
        return None
    return fraction(_sampled(ArrayKey(ground.heat), ground.bounds, frame, True), scale)


def seen_layer(ground: Ground, frame: MapFrame) -> Layer | None:
    """The share of each pixel (height, width) that was seen, 0 .. 1; None without a clip."""
    if ground.clip is None or _empty(ground.bounds):
        return None
    return _seen(ArrayKey(ground.clip), ground.bounds, frame)


@cached_by_identity(8)
def _seen(clip: ArrayKey, bounds: Bounds, frame: MapFrame) -> Layer:
    return np.nan_to_num(sample(seen_cells(np.asarray(clip.array)), bounds, frame, True))


def seen_cells(clip: NDArray[np.generic]) -> NDArray[np.float32]:
    """A clip's cells as 1 where something was seen, else 0."""
    return (np.nan_to_num(np.asarray(clip, dtype=np.float32)) != 0).astype(np.float32)


@cached_by_identity(8)
def _sampled(image: ArrayKey, bounds: Bounds, frame: MapFrame, top_is_y0: bool) -> Layer:
    return sample(np.asarray(image.array), bounds, frame, top_is_y0)


def _empty(bounds: Bounds) -> bool:
    return bounds.width <= 0 or bounds.height <= 0
