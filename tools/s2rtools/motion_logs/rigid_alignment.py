"""Planar transformations of a log: rotation or reflection, translation, optional scale."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import InconclusiveError
from s2rtools.motion_logs.motion_log import Floats, RigidTransform


def fit(
    source: tuple[Floats, Floats],
    target: tuple[Floats, Floats],
    reflection: bool = False,
    scale: bool = False,
) -> RigidTransform:
    """Least-squares transformation of the points `source` (x, y) onto the points `target` (x, y).

    `reflection` allows a mirrored frame where it fits better. Raises InconclusiveError where the
    points do not span a direction. Source: Umeyama, "Least-squares estimation of transformation
    parameters between two point patterns", 1991.
    """
    a, b = np.stack(source), np.stack(target)
    ca, cb = a.mean(axis=1, keepdims=True), b.mean(axis=1, keepdims=True)
    a, b = a - ca, b - cb
    spread = float((a**2).sum())
    if a.shape[1] < 2 or min(spread, float((b**2).sum())) <= 1e-12 * a.shape[1]:
        raise InconclusiveError("the poses do not move: there is nothing to align by")
    u, s, vt = np.linalg.svd(b @ a.T)
    flip = np.linalg.det(u @ vt) < 0
    signs = np.array([1.0, -1.0 if flip and not reflection else 1.0])
    matrix: NDArray[np.float64] = (u * signs) @ vt
    size = float((s * signs).sum()) / spread if scale else 1.0
    reflected = bool(flip and reflection)
    angle = float(np.arctan2(matrix[1, 0], matrix[0, 0]))
    return about(angle, ca[:, 0], cb[:, 0], reflected, size)


def about(
    angle: float, source: Floats, target: Floats, reflected: bool = False, scale: float = 1.0
) -> RigidTransform:
    """The transformation by an angle, rad, that moves the point `source` (2,) to `target` (2,)."""
    cos, sin, sign = np.cos(angle), np.sin(angle), -1.0 if reflected else 1.0
    x = target[0] - scale * (cos * source[0] - sin * sign * source[1])
    y = target[1] - scale * (sin * source[0] + cos * sign * source[1])
    return RigidTransform(angle, reflected, scale, float(x), float(y))
