"""Reproject pixels of one camera rig into another at the same pose, and find the nearer surface."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.camera import Floats, rays
from s2rstore.geometry.camera_offset import RigOffset
from s2rstore.records import Domain, Intrinsics

_ROWS = 8
"""Frames at a time, so that memory does not grow with the batch."""


class Reprojection:
    """Maps pixels of one camera (`lens` of the rig `view`) to the cameras of another rig."""

    def __init__(
        self, view: Domain, lens: Intrinsics, other: Domain, frame: tuple[int, int]
    ) -> None:
        """`frame` is the stored (height, width) of both."""
        rows, cols = (np.arange(extent, dtype=np.float64) + 0.5 for extent in frame)
        self.rays = rays(lens, rows, cols)
        self._frame = frame
        self._rise = view.camera_height - other.camera_height
        self._ahead = view.forward_offset - other.forward_offset

    def targets(
        self, metres: Floats, lens: Intrinsics
    ) -> tuple[Floats, Floats, Floats, NDArray[np.bool_]]:
        """Continuous column and row, and planar depth, in the other rig's camera `lens`.

        `metres` (..., h, w) is planar depth in this camera; NaN where unknown. The last array says
        which pixels fall inside the other image.
        """
        with np.errstate(invalid="ignore", divide="ignore"):
            right = metres * self.rays.right
            up = metres * self.rays.up + self._rise
            ahead = metres * self.rays.forward + self._ahead
            cos, sin = np.cos(lens.pitch), np.sin(lens.pitch)
            depth = cos * ahead + sin * up
            u = lens.cx + lens.fx * right / depth
            v = lens.cy - lens.fy * (cos * up - sin * ahead) / depth
            inside = (u >= 0) & (u < self._frame[1]) & (v >= 0) & (v < self._frame[0])
            return u, v, depth, inside & (depth > 0.05)


class NearerSurface:
    """Depth of one rig, shortened to the nearer of the surfaces that both rigs measure."""

    def __init__(
        self,
        view: Domain,
        other: Domain,
        frame: tuple[int, int],
        pixels: NDArray[np.intp] | None = None,
    ) -> None:
        """`frame` is the stored (height, width) of both rigs.

        `pixels` (m,) are flat indices of the pixels of `view` that are wanted, all by default.
        """
        self._view, self._other = view, other
        self._reprojection = Reprojection(view, view.depth, other, frame)
        if pixels is not None:
            self._reprojection.rays = self._reprojection.rays.at(pixels)

    def __call__(self, depth: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
        """Raw depth of `view`, shortened where the other's raw depth (n, h, w) is less.

        `depth` is (n, h, w), or (n, m) where `pixels` are given. Pixels that either rig did not
        measure keep the value of `view`.
        """
        parts = [
            self._nearer(depth[row : row + _ROWS], other[row : row + _ROWS])
            for row in range(0, len(depth), _ROWS)
        ]
        return np.concatenate(parts) if parts else depth

    def _nearer(self, depth: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
        a, b = self._view, self._other
        valid = (depth >= a.depth_raw_min) & (depth <= a.depth_raw_max)
        metres = np.where(valid, depth * np.float64(a.depth_scale), np.nan)
        u, v, expected, inside = self._reprojection.targets(metres, b.depth)
        col, row = (np.where(inside, value, 0).astype(np.intp) for value in (u, v))
        image = np.arange(len(other)).reshape(-1, *[1] * (depth.ndim - 1))
        values = other[image, row, col]
        measured = inside & (values >= b.depth_raw_min) & (values <= b.depth_raw_max)
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.where(measured, values * np.float64(b.depth_scale) / expected, 1.0)
        nearer = np.rint(depth * np.minimum(share, 1.0))
        least = np.maximum(nearer, a.depth_raw_min)
        return np.where(measured, least, depth).astype(depth.dtype)


def heat_surface(
    view: Domain, other: Domain, is_real: bool, correction: RigOffset | None, surface: str | None
) -> tuple[Domain, Domain | None]:
    """The rig whose rays carry one side's heat to the floor, and the rig of a nearer surface.

    `surface` None is the side's own, as declared; `own` the corrected rig's, `nearer` the nearer of
    both rigs'. The second rig is None where heat lies on the side's own surface.
    """
    if surface is None or correction is None:
        return view, None
    if is_real:
        view = correction.applied(view)
    else:
        other = correction.applied(other)
    return view, other if surface == "nearer" else None
