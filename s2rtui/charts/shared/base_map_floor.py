"""The colours of a floor plan in cells: floor in a narrow range of luminance, and walls.

Dark themes show dark floor with light walls, light themes light floor with dark walls. The range
of the floor leaves every mark its contrast (see `Theme`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds
from s2rtui.analysis.floor_walls import EMPTY, WALL, plan_parts, thin_lines
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.analysis.map_frame import MapFrame, sample
from s2rtui.canvas import Pixels, Theme, luma
from s2rtui.canvas.colour import contrast, with_luminance
from s2rtui.drawing.scale import Interval

Mask = NDArray[np.bool_]

SATURATION = {True: 0.65, False: 0.4}
"""Share of the plan's saturation that the floor keeps, on dark and on light themes."""
_SAMPLES = 256
"""Rows and columns of a plan of which its range of brightness is found."""


@cached_by_identity(4)
def plan_tones(floor_plan: Pixels, width: float) -> Interval:
    """The 5th and 95th percentile of the brightness of a plan's floor, 0 .. 1.

    `width` is that of the plan in metres.
    """
    bright, solid = luma(_thinned(floor_plan)), _thinned(plan_parts(floor_plan, width)).any(axis=-1)
    if solid.all():
        return 0.0, 1.0
    low, high = np.percentile(bright[~solid], (5, 95))
    return float(low), max(float(high), float(low) + 0.05)


def _thinned(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Evenly spaced pixels (_SAMPLES, _SAMPLES, C) of an image."""
    rows, columns = (np.linspace(0, size - 1, _SAMPLES, dtype=int) for size in image.shape[:2])
    return image[rows[:, None], columns]


def floor_colours(floor: NDArray[np.floating], tones: Interval, theme: Theme) -> Pixels:
    """Colours of floor (..., 3), 0 .. 255 with NaN outside the plan, which gets the page colour.

    Brightness between `tones` is spread over the luminances of the theme's floor in equal ratios.
    """
    outside = ~np.isfinite(floor).all(axis=-1)
    floor = np.nan_to_num(floor)
    bright = luma(floor)
    share = np.clip((bright - tones[0]) / (tones[1] - tones[0]), 0, 1)
    low, high = theme.floor
    wanted = low * (high / low) ** share
    grey = 255 * bright[..., None]
    pale = np.rint(np.clip(grey + SATURATION[theme.dark] * (floor - grey), 0, 255)).astype(np.uint8)
    colours = with_luminance(pale, wanted, wanted)
    colours[outside] = theme.background
    return colours


def wall_pixels(
    floor_plan: Pixels, bounds: Bounds, frame: MapFrame, y_down: bool, pixels: tuple[int, int]
) -> tuple[Mask, Mask]:
    """Whether each pixel of the cells (see `sample`) is drawn as wall, and as empty."""
    parts = plan_parts(floor_plan, bounds.width)
    coverage = np.nan_to_num(sample(parts, bounds, frame, y_down, pixels))
    return thin_lines(coverage[..., WALL]), coverage[..., EMPTY] >= 0.5


def draw_walls(layer: Pixels, walls: Mask, heated: Mask, theme: Theme) -> None:
    """Colour the walls of a layer (h, w, 3) in place; on heat in text or page colour.

    On heat, the one that contrasts more with it is taken.
    """
    layer[walls & ~heated] = theme.wall
    hot = walls & heated
    below = layer[hot]
    inverse = contrast(below, theme.background) > contrast(below, theme.text)
    layer[hot] = np.where(inverse[:, None], theme.background, theme.text)
