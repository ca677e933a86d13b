"""Fit the floor of one recording to that of another, by poses that belong together."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.motion_logs.motion_log import fit_transform, transform_about

Floats = NDArray[np.float64]

MIN_PAIRS = 3
_MIN_SPREAD = 0.05
"""Metres of root mean square spread below which positions do not determine a rotation."""


@dataclass(frozen=True, slots=True)
class FloorAlignment:
    """A point p of the moved floor lies at scale * R(angle) p + (x, y); headings turn by `angle`.

    `residual` is the root mean square distance of the pairs in metres, `residual_median` their
    median distance, `residual_angle` the median angle between their headings in radians.
    """

    angle: float
    scale: float
    x: float
    y: float
    pairs: int
    residual: float
    residual_median: float
    residual_angle: float

    def apply(self, poses: Floats) -> Floats:
        """Poses (N, 3) on the other floor."""
        moved = np.asarray(poses, dtype=np.float64).copy()
        cos, sin = self.scale * math.cos(self.angle), self.scale * math.sin(self.angle)
        moved[:, 0] = cos * poses[:, 0] - sin * poses[:, 1] + self.x
        moved[:, 1] = sin * poses[:, 0] + cos * poses[:, 1] + self.y
        moved[:, 2] = angles.wrap(poses[:, 2] + self.angle)
        return moved

    @property
    def motion(self) -> str:
        """The transform in words."""
        scale = f", scaled by {self.scale:.4f}" if self.scale != 1 else ""
        angle = math.degrees(self.angle)
        return f"turned by {angle:.2f} degrees{scale}, moved by ({self.x:.3f}, {self.y:.3f}) m"

    @property
    def text(self) -> str:
        """The transform and its residual in words."""
        return (
            f"{self.motion}; residual of {self.pairs} pairs {self.residual:.3f} m "
            f"(root mean square), {self.residual_median:.3f} m and "
            f"{math.degrees(self.residual_angle):.2f} degrees (median)"
        )


def fit_alignment(moved: Floats, fixed: Floats, with_scale: bool = False) -> FloorAlignment:
    """The rigid motion of the floor, or with `with_scale` the similarity, that fits best.

    `moved` and `fixed` (N, 3) are poses that belong together, x, y in metres and heading in
    radians. Least squares of the distances, without reflection. Where all positions lie together,
    the headings determine the rotation. Raises RequestError for fewer than `MIN_PAIRS`.
    """
    if len(moved) < MIN_PAIRS:
        raise RequestError(f"--align: {len(moved)} pairs; a transform needs at least {MIN_PAIRS}")
    extents = (points[:, :2].std(axis=0) for points in (moved, fixed))
    if min(float(np.hypot(*extent)) for extent in extents) > _MIN_SPREAD:
        motion = fit_transform(
            (moved[:, 0], moved[:, 1]), (fixed[:, 0], fixed[:, 1]), scale=with_scale
        )
    elif with_scale:
        raise RequestError("--align: the positions lie together; they do not determine a scale")
    else:
        turns = fixed[:, 2] - moved[:, 2]
        angle = math.atan2(float(np.sin(turns).sum()), float(np.cos(turns).sum()))
        motion = transform_about(angle, moved[:, :2].mean(axis=0), fixed[:, :2].mean(axis=0))
    found = FloorAlignment(
        motion.angle, motion.scale, motion.x, motion.y, len(moved), math.nan, math.nan, math.nan
    )
    after = found.apply(moved)
    distance = np.hypot(*(after - fixed)[:, :2].T)
    turned = angles.distance(after[:, 2], fixed[:, 2])
    return replace(
        found,
        residual=float(np.sqrt((distance**2).mean())),
        residual_median=float(np.median(distance)),
        residual_angle=float(np.median(turned)),
    )
