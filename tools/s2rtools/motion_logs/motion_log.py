"""Motion logs, commands and drives, independent of file format and simulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

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
