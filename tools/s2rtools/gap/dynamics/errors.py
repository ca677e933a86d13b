"""How far two logs are apart: in metres, in radians, and over a declared scale."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from s2rstore import angles
from s2rstore.errors import RequestError
from s2rtools.logs.contract import Floats, Log
from s2rtools.logs.resample import poses_at
from s2rtools.logs.rigid import Rigid, fit


@dataclass(frozen=True, slots=True)
class Alignment:
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


NONE = Alignment()


@dataclass(frozen=True, slots=True)
class Errors:
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


def ape(real: Log, sim: Log, alignment: Alignment = NONE) -> Errors:
    """Absolute pose error at the real log's times."""
    real, sim = together(real, sim)
    sim = alignment.fitted(real, sim)(sim)
    position = np.hypot(sim.x - real.x, sim.y - real.y)
    return Errors(position, angles.distance(sim.heading, real.heading))


def rpe(real: Log, sim: Log, poses: int = 1, alignment: Alignment = NONE) -> Errors:
    """Relative pose error over every stretch of `poses` poses of the real log.

    The motion from each pose to the one `poses` later, seen from the earlier one, is compared.
    Without scale and reflection an alignment changes nothing.
    """
    real, sim = together(real, sim)
    if not 1 <= poses < real.time.size:
        raise RequestError(f"stretch of {poses} poses: {real.source} has {real.time.size}")
    sim = alignment.fitted(real, sim)(sim)
    start, end = slice(None, -poses), slice(poses, None)
    (ax, ay, at), (bx, by, bt) = (
        moved(*(column[start] for column in columns), *(column[end] for column in columns))
        for columns in ((log.x, log.y, log.heading) for log in (real, sim))
    )
    return Errors(np.hypot(ax - bx, ay - by), angles.distance(at, bt))


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


Scale = Callable[[Log, float], float]
SCALES: dict[str, Scale] = {"extent": extent, "travel": travel}
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
