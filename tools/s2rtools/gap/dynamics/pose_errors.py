"""How far two logs are apart: in metres, in radians, and over a declared scale."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.motion_logs.motion_log import Floats, Log
from s2rtools.motion_logs.resample import poses_at
from s2rtools.motion_logs.rigid_alignment import Rigid, fit


@dataclass(frozen=True, slots=True)
class LogAlignment:
    """What may be taken out before comparing; by default nothing."""

    rigid: bool = False
    reflection: bool = False
    scale: bool = False

    def fitted(self, real: Log, sim: Log) -> Rigid:
        """The motion of `sim` onto `real`, poses at equal times; that of no change by default."""
        if not self.rigid:
            if self.reflection or self.scale:
                raise RequestError("alignment: reflection and scale need rigid as well")
            return Rigid()
        return fit((sim.x, sim.y), (real.x, real.y), self.reflection, self.scale)

    def __str__(self) -> str:
        parts = ("rigid", "reflection", "scale")
        return "+".join(part for part in parts if getattr(self, part)) or "none"


NONE = LogAlignment()


@dataclass(frozen=True, slots=True)
class Step:
    """How far apart two poses are whose motion is compared: so many `poses`, or else `seconds`."""

    seconds: float = 1.0
    poses: int | None = None

    def __str__(self) -> str:
        return f"{self.seconds:g} s" if self.poses is None else f"{self.poses} poses"

    def pairs(self, time: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """First and second of all pairs (k,), within half a median step of `seconds`; maybe none"""
        first = np.arange(time.size)
        if self.poses is not None:
            kept = first[: max(time.size - self.poses, 0)]
            return kept, kept + self.poses
        tolerance = 0.5 * float(np.median(np.diff(time)))
        after = np.searchsorted(time, time + self.seconds)
        before = np.clip(after - 1, 0, time.size - 1)
        after = np.minimum(after, time.size - 1)
        off = [np.abs(time[at] - time - self.seconds) for at in (before, after)]
        second = np.where(off[0] < off[1], before, after)
        near = (second > first) & (np.minimum(*off) <= tolerance * (1 + 1e-6))
        return first[near], second[near]


DEFAULT_STEP = Step()


@dataclass(frozen=True, slots=True)
class PoseErrors:
    """Per compared pose: `position` (n,) in m, `heading` (n,) in rad, in [0, pi]."""

    position: Floats
    heading: Floats


def together(real: Log, sim: Log) -> tuple[Log, Log]:
    """Both logs at the real one's times, where the simulated one is known as well.

    Raises RequestError where fewer than two poses are left.
    """
    within = (real.time >= sim.time[0]) & (real.time <= sim.time[-1])
    time = real.time[within]
    if time.size < 2:
        raise RequestError(f"{real.source} and {sim.source} do not overlap; use one clock")
    x, y, heading = poses_at(sim, time)
    kept = replace(
        real, time=time, x=real.x[within], y=real.y[within], heading=real.heading[within]
    )
    return kept, replace(sim, time=time, x=x, y=y, heading=heading)


def ape(real: Log, sim: Log, alignment: LogAlignment = NONE) -> PoseErrors:
    """Absolute pose error at the real log's times."""
    real, sim = together(real, sim)
    sim = alignment.fitted(real, sim)(sim)
    position = np.hypot(sim.x - real.x, sim.y - real.y)
    return PoseErrors(position, angles.distance(sim.heading, real.heading))


def rpe(
    real: Log, sim: Log, step: Step = DEFAULT_STEP, alignment: LogAlignment = NONE
) -> PoseErrors:
    """Relative pose error over every pair of poses of the real log that are a `step` apart.

    The motion from the first to the second, seen from the first, is compared. Without scale and
    reflection an alignment changes nothing. Raises RequestError where no two are a step apart.
    """
    real, sim = together(real, sim)
    start, end = step.pairs(real.time)
    if not start.size:
        raise RequestError(f"{real.source}: no two poses are {step} apart; give another step")
    sim = alignment.fitted(real, sim)(sim)
    (ax, ay, at), (bx, by, bt) = (
        moved(*(column[start] for column in columns), *(column[end] for column in columns))
        for columns in ((log.x, log.y, log.heading) for log in (real, sim))
    )
    return PoseErrors(np.hypot(ax - bx, ay - by), angles.distance(at, bt))


def moved(
    x: Floats, y: Floats, heading: Floats, x1: Floats, y1: Floats, heading1: Floats
) -> tuple[Floats, Floats, Floats]:
    """The second pose as seen from the first: ahead, to the left (m), turned (rad)."""
    cos, sin = np.cos(heading), np.sin(heading)
    dx, dy = x1 - x, y1 - y
    return cos * dx + sin * dy, cos * dy - sin * dx, heading1 - heading


def rmse(errors: Floats) -> float:
    """Root of the mean square, in the unit of the errors."""
    return float(np.sqrt(np.mean(np.square(errors))))


def extent(log: Log, horizon: float) -> float:
    """Diagonal of the box around the path, m, whatever the horizon."""
    return float(np.hypot(np.ptp(log.x), np.ptp(log.y)))


def travel(log: Log, horizon: float) -> float:
    """Mean speed times `horizon` (s): the metres driven in that time, on average.

    The path is measured over steps of half a second, so that noise adds no length.
    """
    time = np.arange(log.time[0], log.time[-1], 0.5)
    x, y, _ = poses_at(log, np.append(time, log.time[-1]))
    length = np.hypot(np.diff(x), np.diff(y)).sum()
    return float(length / (log.time[-1] - log.time[0]) * horizon)


def deviation(log: Log, horizon: float) -> float:
    """Standard deviation of the places about their mean, m, whatever the horizon."""
    return float(np.hypot(np.std(log.x), np.std(log.y)))


Scale = Callable[[Log, float], float]
SCALES: dict[str, Scale] = {"travel": travel, "extent": extent, "deviation": deviation}
"""What an error in m may be divided by, by the name that is stored beside the figure."""


def scale_of(name: str) -> Scale:
    if name not in SCALES:
        raise RequestError(f"scale {name}: unknown (known: {', '.join(SCALES)})")
    return SCALES[name]


def nrmse(errors: Floats, scale: float) -> float:
    """Root mean square error over a scale, both in m: a share, not a square."""
    if not scale > 0:
        raise RequestError(f"scale {scale:g} m: the real robot did not move")
    return rmse(errors) / scale
