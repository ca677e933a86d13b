"""Absolute and relative pose errors (APE, RPE) of a whole drive, and the scales of NRMSE."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.gap.axis import number
from s2rtools.motion_logs.motion_log import (
    Drive,
    Floats,
    Log,
    RigidTransform,
    fit_transform,
    poses_at,
)

_PARTS = ("rigid", "reflection", "scale")


@dataclass(frozen=True, slots=True)
class LogAlignment:
    """The transformation that is fitted and removed before logs are compared; none by default."""

    rigid: bool = False
    reflection: bool = False
    scale: bool = False

    def estimate(self, real: Log, sim: Log) -> RigidTransform:
        """The transformation of `sim` onto `real`, whose poses have equal times."""
        if not self.rigid:
            if self.reflection or self.scale:
                raise RequestError("alignment: reflection and scale need rigid as well")
            return RigidTransform()
        return fit_transform((sim.x, sim.y), (real.x, real.y), self.reflection, self.scale)

    @classmethod
    def parse(cls, text: str) -> LogAlignment:
        """Parse `none`, or `rigid` with any of `+reflection` and `+scale`. Raises RequestError."""
        parts = [] if text == "none" else text.split("+")
        known = set(parts) <= set(_PARTS) and len(set(parts)) == len(parts)
        if not known or (parts and "rigid" not in parts):
            raise RequestError("expected none, or rigid with any of +reflection and +scale")
        return cls(*(part in parts for part in _PARTS))

    def __str__(self) -> str:
        return "+".join(part for part in _PARTS if getattr(self, part)) or "none"


NO_ALIGNMENT = LogAlignment()


@dataclass(frozen=True, slots=True)
class RpeStep:
    """Step between the two poses of a pair: a number of `poses`, or `seconds` where it is None."""

    seconds: float = 1.0
    poses: int | None = None

    @classmethod
    def parse(cls, text: str) -> RpeStep:
        """Parse seconds such as `1s`, or a number of poses. Raises RequestError."""
        expected = "seconds such as 1s, or a number of poses such as 25"
        if text.endswith("s"):
            return cls(seconds=number(text[:-1], expected, 3600.0))
        poses = number(text, expected, 1e9)
        if poses != int(poses):
            raise RequestError(f"expected {expected}")
        return cls(poses=int(poses))

    def __str__(self) -> str:
        return f"{self.seconds:g} s" if self.poses is None else f"{self.poses} poses"

    def pairs(self, time: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Indices (k,) of the first and second pose of every pair; k may be 0.

        Steps in seconds have a tolerance of half a median step of the log.
        """
        first = np.arange(time.size)
        if self.poses is not None:
            first = first[: max(time.size - self.poses, 0)]
            return first, first + self.poses
        tolerance = 0.5 * float(np.median(np.diff(time)))
        after = np.searchsorted(time, time + self.seconds)
        before = np.clip(after - 1, 0, time.size - 1)
        after = np.minimum(after, time.size - 1)
        deviations = [np.abs(time[at] - time - self.seconds) for at in (before, after)]
        second = np.where(deviations[0] < deviations[1], before, after)
        near = (second > first) & (np.minimum(*deviations) <= tolerance * (1 + 1e-6))
        return first[near], second[near]


DEFAULT_STEP = RpeStep()


@dataclass(frozen=True, slots=True)
class PoseErrors:
    """Errors of the compared poses: `position` (n,) in m, `heading` (n,) in rad, in [0, pi]."""

    position: Floats
    heading: Floats


def drive_errors(
    drive: Drive, sim: Log, alignment: LogAlignment, step: RpeStep
) -> dict[str, float | None]:
    """Root mean square APE and RPE of a whole drive, in m and rad.

    `sim` is the drive's simulated log without its time delay; `ape_rmse_recorded` is computed with
    the delay. The RPE figures are None where no two poses are a step apart.
    """
    absolute = ape(drive.real, sim, alignment)
    recorded = ape(drive.real, drive.sim, alignment)
    relative: dict[str, float | None] = {"rpe_rmse": None, "rpe_heading_rmse": None}
    try:
        steps = rpe(drive.real, sim, step, alignment)
        relative = {"rpe_rmse": rmse(steps.position), "rpe_heading_rmse": rmse(steps.heading)}
    except RequestError:
        pass
    return {
        "ape_rmse": rmse(absolute.position),
        "ape_rmse_recorded": rmse(recorded.position),
        "heading_rmse": rmse(absolute.heading),
        **relative,
    }


def resample_pair(real: Log, sim: Log) -> tuple[Log, Log]:
    """Both logs at the times of the real one, where the simulated one covers them.

    Raises RequestError where fewer than two poses remain.
    """
    within = (real.time >= sim.time[0]) & (real.time <= sim.time[-1])
    time = real.time[within]
    if time.size < 2:
        raise RequestError(f"{real.source} and {sim.source} do not overlap; use one clock")
    x, y, heading = poses_at(sim, time)
    covered = replace(
        real, time=time, x=real.x[within], y=real.y[within], heading=real.heading[within]
    )
    return covered, replace(sim, time=time, x=x, y=y, heading=heading)


def ape(real: Log, sim: Log, alignment: LogAlignment = NO_ALIGNMENT) -> PoseErrors:
    """Absolute pose error at the times of the real log."""
    real, sim = resample_pair(real, sim)
    sim = alignment.estimate(real, sim)(sim)
    position = np.hypot(sim.x - real.x, sim.y - real.y)
    return PoseErrors(position, angles.distance(sim.heading, real.heading))


def rpe(
    real: Log, sim: Log, step: RpeStep = DEFAULT_STEP, alignment: LogAlignment = NO_ALIGNMENT
) -> PoseErrors:
    """Relative pose error over all pairs of poses of the real log that are one `step` apart.

    Compares the motion from the first to the second pose in the frame of the first. A rigid
    alignment without scale and reflection does not change it. Raises RequestError where no two
    poses are a step apart.
    """
    real, sim = resample_pair(real, sim)
    start, end = step.pairs(real.time)
    if not start.size:
        raise RequestError(f"{real.source}: no two poses are {step} apart; give another step")
    sim = alignment.estimate(real, sim)(sim)
    (ax, ay, at), (bx, by, bt) = (
        relative_pose(*(column[start] for column in columns), *(column[end] for column in columns))
        for columns in ((log.x, log.y, log.heading) for log in (real, sim))
    )
    return PoseErrors(np.hypot(ax - bx, ay - by), angles.distance(at, bt))


def relative_pose(
    x: Floats, y: Floats, heading: Floats, x1: Floats, y1: Floats, heading1: Floats
) -> tuple[Floats, Floats, Floats]:
    """The second pose in the frame of the first: forward, left (m) and rotation (rad)."""
    cos, sin = np.cos(heading), np.sin(heading)
    dx, dy = x1 - x, y1 - y
    return cos * dx + sin * dy, cos * dy - sin * dx, heading1 - heading


def rmse(errors: Floats) -> float:
    """Root mean square, in the unit of the errors."""
    return float(np.sqrt(np.mean(np.square(errors))))


def extent(log: Log, horizon: float) -> float:
    """Diagonal of the path's bounding box, m; independent of the horizon."""
    return float(np.hypot(np.ptp(log.x), np.ptp(log.y)))


def travel(log: Log, horizon: float) -> float:
    """Mean distance driven in `horizon` seconds, m.

    The path is measured in steps of half a second, so that sensor noise adds no length.
    """
    time = np.arange(log.time[0], log.time[-1], 0.5)
    x, y, _ = poses_at(log, np.append(time, log.time[-1]))
    length = np.hypot(np.diff(x), np.diff(y)).sum()
    return float(length / (log.time[-1] - log.time[0]) * horizon)


def deviation(log: Log, horizon: float) -> float:
    """Standard deviation of the positions about their mean, m; independent of the horizon."""
    return float(np.hypot(np.std(log.x), np.std(log.y)))


Scale = Callable[[Log, float], float]
SCALES: dict[str, Scale] = {"travel": travel, "extent": extent, "deviation": deviation}
"""Lengths that normalise an error in metres (NRMSE), by the name that reports carry."""
