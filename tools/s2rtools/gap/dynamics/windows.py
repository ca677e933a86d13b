"""Errors of simulated motion over time windows, each restarted from a real pose, and their means.

The simulated motion of a window is attached to the real pose at the window's start; the error of
the window is the distance between the two poses at its end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rstore.intervals import Interval, of_units
from s2rtools.gap.axis import number
from s2rtools.gap.dynamics.ape_rpe import relative_pose
from s2rtools.motion_logs.motion_log import Floats, Log, poses_at

MAX_GAP = 5.0
"""Longest gap between two poses that is interpolated, in median steps of the log."""
_BATCH_STEPS = 700_000
"""Steps of all windows that are processed at once; bounds memory."""
_TOLERANCE = 1e-9
_SEED = 3
"""Seed of the scattered starts and lengths, the same for every log."""


@dataclass(frozen=True, slots=True)
class WindowPlan:
    """Windows of each of `horizons` (s), one every `stride` s, compared at `rate` Hz.

    Starts are shifted at random, evenly, by up to `scatter` of a stride, lengths by up to `scatter`
    of a horizon: otherwise a vibration whose period divides both would go unnoticed.
    """

    horizons: tuple[float, ...] = (0.5, 1.0, 2.0, 5.0)
    stride: float = 0.25
    rate: float = 50.0
    scatter: float = 0.25

    @classmethod
    def parse(cls, text: str) -> WindowPlan:
        """Parse horizons in seconds; windows start every half of the shortest one."""
        horizons = tuple(number(part, "seconds such as 0.5,1,2") for part in text.split(","))
        if not all(0 < horizon <= 3600 for horizon in horizons):
            raise RequestError("expected seconds above 0, up to 3600")
        return cls(horizons, stride=0.5 * horizons[0])

    def __post_init__(self) -> None:
        rising = all(a < b for a, b in pairwise((0.0, *self.horizons)))
        if not self.horizons or not rising:
            raise RequestError(f"horizons {self.horizons}: must be positive and increasing")
        if not (self.stride > 0 and self.rate > 0):
            raise RequestError(f"stride {self.stride:g} s, rate {self.rate:g} Hz: must be positive")
        if not 0 <= self.scatter < 0.5:
            raise RequestError(f"scatter {self.scatter:g}: must be from 0 to below 0.5")
        if self.horizons[0] * (1 - self.scatter) * self.rate < 1:
            raise RequestError(f"horizon {self.horizons[0]:g} s is less than one step of the rate")

    def starts(self, real: Log) -> Floats:
        """Start times (K,) of all windows in which the shortest horizon fits."""
        available = real.time[-1] - real.time[0] - self.horizons[0]
        count = int(np.floor(available / self.stride + _TOLERANCE)) + 1
        at = np.arange(max(count, 0)) + self._offsets((max(count, 0),))
        return real.time[0] + np.maximum(at, 0.0) * self.stride

    def steps(self, windows: int) -> NDArray[np.int64]:
        """Length of each window (H, K) in steps of `rate`."""
        offsets = self._offsets((len(self.horizons), windows))
        lengths = np.array(self.horizons)[:, None] * (1 + offsets)
        return np.round(lengths * self.rate).astype(np.int64)

    @property
    def longest(self) -> float:
        """Upper bound of the windows' lengths, s."""
        return self.horizons[-1] * (1 + self.scatter) + 1 / self.rate

    def _offsets(self, shape: tuple[int, ...]) -> Floats:
        return np.random.default_rng([_SEED, len(shape)]).uniform(
            -self.scatter, self.scatter, shape
        )


DEFAULT = WindowPlan()


@dataclass(frozen=True, slots=True)
class DriveWindows:
    """Errors (H, K) by horizon and start; NaN where a log has no pose at an end.

    `end` is the position error at the window's end and `path` its root mean square within the
    window, in m; `heading` is the error at the end, in rad; `distance` is the straight line between
    the real poses at both ends, in m. `starts` (K,) and `lengths` (H, K) are in s.
    """

    starts: Floats
    lengths: Floats
    end: Floats
    path: Floats
    heading: Floats
    distance: Floats


def windows(real: Log, sim: Log, plan: WindowPlan = DEFAULT) -> DriveWindows:
    """Compute all windows of `plan`; the time delay of `sim` must already be removed."""
    starts = plan.starts(real)
    steps = plan.steps(starts.size)
    errors = DriveWindows(
        starts, steps / plan.rate, *(np.full(steps.shape, np.nan) for _ in range(4))
    )
    batch = max(_BATCH_STEPS // int(steps.max(initial=1)), 1)
    for first in range(0, starts.size, batch):
        part = slice(first, first + batch)
        _fill_windows(errors, part, real, sim, steps[:, part], plan.rate)
    return errors


def _fill_windows(
    errors: DriveWindows, part: slice, real: Log, sim: Log, steps: NDArray[np.int64], rate: float
) -> None:
    ahead = np.arange(steps.max() + 1) / rate
    times = errors.starts[part, None] + ahead
    times[np.abs(times - real.time[-1]) < 1e-6] = real.time[-1]
    real_motion, sim_motion = (_motions(log, times) for log in (real, sim))
    distance = np.hypot(real_motion[0] - sim_motion[0], real_motion[1] - sim_motion[1])
    turn = angles.distance(real_motion[2], sim_motion[2])
    squares = np.cumsum(distance[:, 1:] ** 2, axis=1)
    each = np.arange(steps.shape[1])
    for row, step in enumerate(steps):
        at = (each, step)
        errors.end[row, part] = distance[at]
        errors.path[row, part] = np.sqrt(squares[each, step - 1] / step)
        errors.heading[row, part] = turn[at]
        errors.distance[row, part] = np.hypot(real_motion[0][at], real_motion[1][at])


def _motions(log: Log, times: Floats) -> tuple[Floats, Floats, Floats]:
    """Poses at `times` (k, t) in the frame of the first pose of each row."""
    x, y, heading = poses_at(log, times, MAX_GAP * float(np.median(np.diff(log.time))))
    return relative_pose(x[:, :1], y[:, :1], heading[:, :1], x, y, heading)


class WindowUnits:
    """The independent units of the windows of some drives, without each of which statistics are
    computed.

    Several drives are units as a whole. One drive is cut into contiguous blocks of windows that are
    at least as long as the windows that overlap each other.
    """

    def __init__(self, counts: Sequence[int], longest: int) -> None:
        """`counts`: windows of each drive; `longest`: windows that the longest one overlaps."""
        self.drives = len(counts)
        self._edges: NDArray[np.intp] = np.zeros(1, dtype=np.intp)
        if self.drives == 1:
            length = max(1, longest, int(np.ceil(np.sqrt(counts[0]))))
            blocks = max(1, counts[0] // length)
            self._edges = np.arange(blocks) * counts[0] // blocks
        self.count = self.drives if self.drives > 1 else self._edges.size
        self.unit = "drives" if self.drives > 1 else "blocks of windows"

    def means(self, values: Sequence[Floats]) -> tuple[Floats, Floats]:
        """Mean over the windows of all drives (H,), and without each unit (H, G).

        `values` holds (H, K) per drive, NaN where there is no window.
        """
        sums = self._sums([np.nan_to_num(table) for table in values])
        counts = self._sums([np.isfinite(table).astype(np.float64) for table in values])
        mean = sums.sum(axis=1) / np.maximum(counts.sum(axis=1), 1)
        others = counts.sum(axis=1, keepdims=True) - counts
        with np.errstate(divide="ignore", invalid="ignore"):
            left_out = (sums.sum(axis=1, keepdims=True) - sums) / others
        return mean, np.where(others > 0, left_out, np.nan)

    def drive_means(self, values: Floats, weights: Floats) -> tuple[Floats, Floats]:
        """Weighted mean (H,) of one value per drive (drives, H), and without each unit (H, G)."""
        total = weights @ values / weights.sum()
        if self.drives == 1:
            return total, np.repeat(total[:, None], self.count, axis=1)
        rest = weights.sum() - weights
        return total, (weights @ values - weights[:, None] * values).T / rest

    def interval(self, value: float, left_out: Floats, level: float) -> Interval:
        """The interval of a statistic from its values (G,) without each unit."""
        return of_units(value, left_out, unit=self.unit, level=level)

    def _sums(self, values: Sequence[Floats]) -> Floats:
        """Sums (H, G) over the windows of each unit."""
        if self.drives > 1:
            return np.stack([table.sum(axis=1) for table in values], axis=1)
        return np.asarray(np.add.reduceat(values[0], self._edges, axis=1))
