"""Windows of about several horizons, each restarted from a real state.

The motion that the simulator makes from a window's start is put onto the real pose at that time;
what is left between the two ends is the window's error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.gap.dynamics.pose_errors import moved
from s2rtools.motion_logs.motion_log import Floats, Log
from s2rtools.motion_logs.resample import poses_at

HOLE = 5.0
"""Median steps between two poses beyond which nothing is known between them."""
_CELLS = 700_000
"""Steps of all windows that are looked at together."""
_TOLERANCE = 1e-9
_SEED = 3
"""Of the scattered starts and lengths: the same for every log."""


@dataclass(frozen=True, slots=True)
class WindowPlan:
    """`horizons` in s, a window of each from every `stride` s, compared at `rate` Hz.

    `scatter` is the share of a stride by which starts, and of a horizon by which lengths are moved
    to either side, evenly at random: a vibration whose period divides both would not be seen.
    """

    horizons: tuple[float, ...] = (0.5, 1.0, 2.0, 5.0)
    stride: float = 0.25
    rate: float = 50.0
    scatter: float = 0.25

    def __post_init__(self) -> None:
        rising = all(a < b for a, b in zip((0.0, *self.horizons), self.horizons, strict=False))
        if not self.horizons or not rising:
            raise RequestError(f"horizons {self.horizons}: give rising positive seconds")
        if not (self.stride > 0 and self.rate > 0):
            raise RequestError(f"stride {self.stride:g} s, rate {self.rate:g} Hz: must be positive")
        if not 0 <= self.scatter < 0.5:
            raise RequestError(f"scatter {self.scatter:g}: must be from 0 to below 0.5")
        if self.horizons[0] * (1 - self.scatter) * self.rate < 1:
            raise RequestError(f"horizon {self.horizons[0]:g} s is less than one step of the rate")

    def starts(self, real: Log) -> Floats:
        """Times of the windows' starts (K,), about as many as hold the shortest horizon."""
        room = real.time[-1] - real.time[0] - self.horizons[0]
        count = int(np.floor(room / self.stride + _TOLERANCE)) + 1
        at = np.arange(max(count, 0)) + self._moved((max(count, 0),))
        return real.time[0] + np.maximum(at, 0.0) * self.stride

    def steps(self, windows: int) -> NDArray[np.int64]:
        """Length of each window (H, K) in steps of the rate."""
        moved = self._moved((len(self.horizons), windows))
        return np.round(np.array(self.horizons)[:, None] * (1 + moved) * self.rate).astype(np.int64)

    @property
    def longest(self) -> float:
        """s; no window is longer."""
        return self.horizons[-1] * (1 + self.scatter) + 1 / self.rate

    def _moved(self, shape: tuple[int, ...]) -> Floats:
        return np.random.default_rng([_SEED, len(shape)]).uniform(
            -self.scatter, self.scatter, shape
        )


DEFAULT = WindowPlan()


@dataclass(frozen=True, slots=True)
class DriveWindows:
    """Errors per horizon and start, (H, K); NaN where a log does not know an end.

    `end` at the end and `path` as root mean square on the way, in m; `heading` at the end, in rad;
    `distance` is the straight line that the real robot covered, in m. `starts` (K,) in s,
    `lengths` (H, K) in s.
    """

    starts: Floats
    lengths: Floats
    end: Floats
    path: Floats
    heading: Floats
    distance: Floats


def windows(real: Log, sim: Log, plan: WindowPlan = DEFAULT) -> DriveWindows:
    """All windows of `plan`; `sim` with its delay already taken out."""
    starts = plan.starts(real)
    steps = plan.steps(starts.size)
    made = DriveWindows(
        starts, steps / plan.rate, *(np.full(steps.shape, np.nan) for _ in range(4))
    )
    together = max(_CELLS // int(steps.max(initial=1)), 1)
    for first in range(0, starts.size, together):
        part = slice(first, first + together)
        _fill(made, part, real, sim, steps[:, part], plan.rate)
    return made


def _fill(
    made: DriveWindows, part: slice, real: Log, sim: Log, steps: NDArray[np.int64], rate: float
) -> None:
    ahead = np.arange(steps.max() + 1) / rate
    times = made.starts[part, None] + ahead
    times[np.abs(times - real.time[-1]) < 1e-6] = real.time[-1]
    real_motion, sim_motion = (_motions(log, times) for log in (real, sim))
    apart = np.hypot(real_motion[0] - sim_motion[0], real_motion[1] - sim_motion[1])
    turned = angles.distance(real_motion[2], sim_motion[2])
    squares = np.cumsum(apart[:, 1:] ** 2, axis=1)
    each = np.arange(steps.shape[1])
    for row, step in enumerate(steps):
        at = (each, step)
        made.end[row, part] = apart[at]
        made.path[row, part] = np.sqrt(squares[each, step - 1] / step)
        made.heading[row, part] = turned[at]
        made.distance[row, part] = np.hypot(real_motion[0][at], real_motion[1][at])


def _motions(log: Log, times: Floats) -> tuple[Floats, Floats, Floats]:
    """Poses at `times` (k, t) as seen from those at the first of each row."""
    x, y, heading = poses_at(log, times, HOLE * float(np.median(np.diff(log.time))))
    return moved(x[:, :1], y[:, :1], heading[:, :1], x, y, heading)
