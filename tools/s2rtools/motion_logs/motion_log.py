"""Motion logs, commands and drives, independent of file format and simulator.

Planar transformations of logs: rotation or reflection, translation, optional scale.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import InconclusiveError
from s2rstore.geometry import angles

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Log:
    """Poses over time: `time` (n,) in s, strictly increasing; `x`, `y` (n,) in m; `heading` (n,) in
    rad, forward = (cos, sin); all finite. `source` names the log in messages, `sha256` is the hash
    of its content, `warnings` are sentences about possible defects.
    """

    time: Floats
    x: Floats
    y: Floats
    heading: Floats
    source: str
    sha256: str
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Commands:
    """Commands to a robot: `time` (k,) in s, strictly increasing; the value of each channel (k,)
    applies until the next time. `period` (s) is that of the controller.
    """

    time: Floats
    channels: Mapping[str, Floats]
    period: float
    source: str
    sha256: str


@dataclass(frozen=True, slots=True)
class RigidTransform:
    """p -> scale * R(angle) * p + (x, y), with y mirrored first if `reflected`; rad and m."""

    angle: float = 0.0
    reflected: bool = False
    scale: float = 1.0
    x: float = 0.0
    y: float = 0.0

    def __str__(self) -> str:
        parts = [
            "mirrored" if self.reflected else "",
            f"turned by {np.degrees(self.angle):.1f} degrees",
            f"scaled by {self.scale:.4g}" if self.scale != 1 else "",
            f"moved by ({self.x:.2f}, {self.y:.2f}) m",
        ]
        return ", ".join(part for part in parts if part)

    def __call__(self, log: Log) -> Log:
        """The transformed log."""
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        sign = -1.0 if self.reflected else 1.0
        x = self.scale * (cos * log.x - sin * sign * log.y) + self.x
        y = self.scale * (sin * log.x + cos * sign * log.y) + self.y
        return replace(log, x=x, y=y, heading=angles.wrap(sign * log.heading + self.angle))


@dataclass(frozen=True, slots=True)
class Drive:
    """Logs of one command sequence in reality and in simulation.

    `untuned` is the log of the simulator before any identification, the declared bad state.
    `odometry` is the transformation that aligned odometry, used in place of a simulated log, with
    the ground truth.
    """

    name: str
    real: Log
    sim: Log
    untuned: Log | None = None
    commands: Commands | None = None
    odometry: RigidTransform | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings of all logs."""
        logs = (self.real, self.sim, self.untuned)
        return tuple(each for log in logs if log is not None for each in log.warnings)


def poses_at(log: Log, times: Floats, longest: float = np.inf) -> tuple[Floats, Floats, Floats]:
    """x, y, heading at `times` by linear interpolation; the heading is continuous, not wrapped.

    NaN outside the log, and between poses that are more than `longest` s apart.
    """
    columns = (log.x, log.y, np.unwrap(log.heading))
    x, y, heading = (np.interp(times, log.time, c, left=np.nan, right=np.nan) for c in columns)
    if longest < np.inf:
        right = np.clip(np.searchsorted(log.time, times), 1, log.time.size - 1)
        hole = np.diff(log.time)[right - 1] > longest
        hole &= (times > log.time[right - 1]) & (times < log.time[right])
        x, y, heading = (np.where(hole, np.nan, values) for values in (x, y, heading))
    return x, y, heading


def fit_transform(
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
    return transform_about(angle, ca[:, 0], cb[:, 0], reflected, size)


def transform_about(
    angle: float, source: Floats, target: Floats, reflected: bool = False, scale: float = 1.0
) -> RigidTransform:
    """The transformation by an angle, rad, that moves the point `source` (2,) to `target` (2,)."""
    cos, sin, sign = np.cos(angle), np.sin(angle), -1.0 if reflected else 1.0
    x = target[0] - scale * (cos * source[0] - sin * sign * source[1])
    y = target[1] - scale * (sin * source[0] + cos * sign * source[1])
    return RigidTransform(angle, reflected, scale, float(x), float(y))
