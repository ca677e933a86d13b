"""Walls and empty parts of a floor plan, found in its picture.

Plans draw what is no floor in one dark colour: walls as bands of it, and the surroundings of a
building that was scanned or mapped as areas of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.identity_cache import cached_by_identity

Mask = NDArray[np.bool_]

WALL, EMPTY = 0, 1
"""Planes of `plan_parts`."""
THINNEST_WALL, USUAL_WALL = 0.06, 0.1
"""Metres; thinner lines are noise, and lines below the usual thickness are walls only where they
continue one of it."""
NARROWEST_FLOOR = 0.2
"""Metres; narrower stripes of other colours belong to the walls and empty areas around them."""
EDGE = 0.12
"""Thickness in metres of the walls around areas of the dark colour; what is inside is empty."""
_DARK = 0.6
"""Largest brightness of the walls' colour, as a share of the brightest parts of the plan."""
_LEAST_SHARE, _LEAST_PEAK = 0.005, 0.0005
"""Smallest share of the plan in the walls' colour, and in its most common shade; below them the
plan has no walls."""
_TOLERANCE = 14
"""Difference of a channel from the walls' colour, as in compressed images."""
_WINDOW, _LEAST_FILLED = 1.2, 0.08
"""Metres around a pixel of a wall, and the share of the walls' colour in them. Furniture has less
of the colour, or smaller pieces."""
_LEAST_COVERED = 0.08
"""Share of a pixel below which a thin line is not drawn."""
_FINEST = 0.02
"""Metres of a pixel below which plans are reduced first."""


@cached_by_identity(4)
def plan_parts(floor_plan: NDArray[np.uint8], width: float) -> NDArray[np.uint8]:
    """Where a plan (H, W, 3) shows walls and where it is empty: (h, w, 2) of 0 and 1, read-only.

    `width` is the width of the plan in metres. Larger plans are reduced to pixels of 2 cm. Plans
    without a dark colour of their own have neither.
    """
    shrink = max(1, int(_FINEST / (width / floor_plan.shape[1])))
    solid = _solid(floor_plan[shrink // 2 :: shrink, shrink // 2 :: shrink])
    metre = solid.shape[1] / width
    solid = ~_opened(~_without_specks(solid, metre), NARROWEST_FLOOR * metre)
    empty = solid & ~_dilated(~solid, max(1, round(EDGE * metre)))
    parts = np.stack([solid & ~empty, empty], axis=-1).astype(np.uint8)
    parts.setflags(write=False)
    return parts


def _solid(floor_plan: NDArray[np.uint8]) -> Mask:
    """Where a plan has its most common dark colour, if that is common enough."""
    coarse = (floor_plan >> 2).astype(np.uint32)
    codes = (coarse[..., 0] << 12) | (coarse[..., 1] << 6) | coarse[..., 2]
    counts = np.bincount(codes.ravel(), minlength=1 << 18)
    found = np.flatnonzero(counts)
    colours = np.stack([found >> 12, found >> 6 & 63, found & 63], axis=-1) * 4 + 2
    bright = colours @ np.array([0.2126, 0.7152, 0.0722])
    order = np.argsort(bright)
    upper = bright[order][np.searchsorted(np.cumsum(counts[found][order]), 0.98 * codes.size)]
    dark = bright <= _DARK * upper
    nothing = np.zeros(codes.shape, dtype=np.bool_)
    if not dark.any() or counts[found][dark].max() < _LEAST_PEAK * codes.size:
        return nothing
    colour = colours[dark][counts[found][dark].argmax()]
    low, high = np.clip(colour - _TOLERANCE, 0, 255), np.clip(colour + _TOLERANCE, 0, 255)
    solid = np.asarray(((floor_plan >= low) & (floor_plan <= high)).all(axis=-1))
    return solid if solid.mean() >= _LEAST_SHARE else nothing


def _without_specks(solid: Mask, metre: float) -> Mask:
    """Drop thin lines, and pieces with little of the colour around them, as of furniture."""
    from scipy import ndimage  # not when the program starts

    reach = max(1, round(_WINDOW * metre / 2))
    kept = _opened(solid, USUAL_WALL * metre) & (_filled(solid, reach) >= _LEAST_FILLED)
    solid = _opened(solid, THINNEST_WALL * metre)
    near = np.ones((3, 3))
    return np.asarray(ndimage.binary_dilation(kept & solid, near, iterations=reach, mask=solid))


def _filled(mask: Mask, reach: int) -> NDArray[np.float32]:
    """The share of a mask within `reach` pixels in both directions of each pixel."""
    from scipy import ndimage

    size, everything = 2 * reach + 1, np.ones(mask.shape, dtype=np.float32)
    held, inside = (
        ndimage.uniform_filter(part.astype(np.float32), size, mode="constant")
        for part in (mask, everything)
    )
    return np.asarray(held / inside)


def _dilated(mask: Mask, reach: int) -> Mask:
    """The mask grown by `reach` pixels in both directions, a square neighbourhood."""
    from scipy import ndimage

    return np.asarray(ndimage.maximum_filter(mask, 2 * reach + 1, mode="constant"))


def _opened(mask: Mask, size: float) -> Mask:
    """The parts of a mask that squares of at most `size` pixels fit into."""
    reach = max(0, int((size - 1) / 2))
    return _dilated(~_dilated(~mask, reach), reach) & mask


def thin_lines(coverage: NDArray[np.floating]) -> Mask:
    """Which pixels (h, w) are drawn for a mask, by the share of each that it covers.

    Those that are mostly covered, and, so that lines thinner than a pixel stay whole and one pixel
    wide, those that are covered more than the pixels at both of their sides.
    """
    peak = _peaks(coverage) | _peaks(coverage.T).T
    return np.asarray((coverage >= 0.75) | (peak & (coverage >= _LEAST_COVERED)))


def _peaks(values: NDArray[np.floating]) -> Mask:
    """Where values (h, w) exceed those above and below; of two equal rows, in the upper one."""
    before, _, after, further = (
        np.pad(values, ((1, 2), (0, 0)))[k:][: len(values)] for k in range(4)
    )
    tied = (values == after) & (values > further)
    return np.asarray((values > before) & ((values > after) | tied))
