"""Floors of the dynamics axis: window errors of a perfect simulator.

They come from real drives that repeat the same commands, else from the noise of the real poses.

The noise of a pose is estimated from its distance to the cubic through two neighbours on each side:
white noise is captured in full, slower errors (drift, filters) are not. Motion contributes as well,
the more the coarser the poses; the excess of every second pose over all poses is attributed to
motion and subtracted, so that the floor is too low rather than too high.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from s2rstore.errors import RequestError
from s2rtools.gap.axis import number
from s2rtools.gap.delay.time_delay import estimate_delay, shifted
from s2rtools.gap.dynamics.windows import DriveWindows, WindowPlan, windows
from s2rtools.motion_logs.motion_log import Commands, Drive, Floats, Log

_TRIM = 0.95
_TRIMMED_SQUARE = 0.7589
"""Mean square of a standard normal value after trimming to the `_TRIM` smallest in size."""
_MIN_POSES = 9
_GROWTH = 8.0
"""Lower bound, less 1, of the growth of the motion's squares from all poses to every second.

Measured on first-order motors (0.15 s): 30 and more from 8 Hz on, 14 at 4 Hz; `log_quality` refuses
slower poses.
"""
_TIME_TOLERANCE = 1e-3
"""Largest difference of the times of equal commands, s."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations of pose noise: `position` in m (x and y together), `heading` in rad.

    `motion` (m) is the part of the deviations that was attributed to motion and subtracted.
    """

    position: float
    heading: float
    motion: float = 0.0

    @classmethod
    def parse(cls, text: str) -> Noise | None:
        """Parse `measured` (None), or metres and radians. Raises RequestError."""
        if text == "measured":
            return None
        expected = "measured, or metres and radians such as 0.002,0.003"
        values = [number(part, expected) for part in text.split(",")]
        if len(values) != 2 or min(values) < 0:
            raise RequestError(f"expected {expected}")
        return cls(*values)

    def __str__(self) -> str:
        return f"{self.position:g} m, {self.heading:g} rad"


def estimate_noise(log: Log) -> Noise:
    """White measurement noise of a log; 0 where it has fewer than 18 poses."""
    if log.time.size < 2 * _MIN_POSES:
        return Noise(0.0, 0.0)
    columns = (log.x, log.y, np.unwrap(log.heading))
    fine, coarse = (
        np.array([_square(log.time[::k], column[::k]) for column in columns]) for k in (1, 2)
    )
    motion = np.minimum(np.maximum(coarse - fine, 0.0) / _GROWTH, fine)
    x, y, heading = fine - motion
    return Noise(float(np.sqrt(x + y)), float(np.sqrt(heading)), float(np.sqrt(motion[:2].sum())))


def noise_squares(real: Log, windows: DriveWindows, noise: Noise) -> Floats:
    """Expected squared end errors (horizons H, windows K), m^2, if only the real poses were noisy.

    `windows` are those of `real`; noise of simulated poses is not subtracted. With noise n of the
    positions and v of the heading: sum of n^2 + 2 D^2 (1 - exp(-v^2 / 2)), D the distance covered.
    """
    start = _interpolated_variance(real, windows.starts)
    end = _interpolated_variance(real, windows.starts + windows.lengths)
    squares = noise.position**2 * (start + end)
    squares += 2 * windows.distance**2 * -np.expm1(-(noise.heading**2) * start / 2)
    return np.where(np.isnan(windows.end), np.nan, squares)


def _square(time: Floats, values: Floats) -> float:
    """Noise variance of values, from their distance to the cubic through their neighbours."""
    weights = _lagrange_weights(time)
    around = np.stack([values[j : values.size - 4 + j] for j in (0, 1, 3, 4)], axis=1)
    deviations = values[2:-2] - (around * weights).sum(axis=1)
    squares = np.sort((deviations / np.sqrt(1 + (weights**2).sum(axis=1))) ** 2)
    trimmed = squares[: max(int(_TRIM * squares.size), 1)]  # excludes sharp turns of the motion
    return float(trimmed.mean() / _TRIMMED_SQUARE)


def _lagrange_weights(time: Floats) -> Floats:
    """Lagrange weights (n - 4, 4) of the neighbours i - 2, i - 1, i + 1, i + 2 at time i."""
    at = np.stack([time[j : time.size - 4 + j] for j in (0, 1, 3, 4)], axis=1) - time[2:-2, None]
    weights = np.ones_like(at)
    for j in range(4):
        for k in range(4):
            if k != j:
                weights[:, j] *= -at[:, k] / (at[:, j] - at[:, k])
    return weights


def _interpolated_variance(log: Log, times: Floats) -> Floats:
    """Share of the noise variance that remains in linear interpolation between two poses."""
    right = np.clip(np.searchsorted(log.time, times), 1, log.time.size - 1)
    f = (times - log.time[right - 1]) / (log.time[right] - log.time[right - 1])
    f = np.clip(f, 0.0, 1.0)
    return np.asarray((1 - f) ** 2 + f**2)


def same_commands(a: Commands, b: Commands) -> bool:
    """Whether both hold the same values at the same times after their start."""
    if a.time.size != b.time.size or a.channels.keys() != b.channels.keys():
        return False
    offsets = (a.time - a.time[0]) - (b.time - b.time[0])
    return bool(np.abs(offsets).max() <= _TIME_TOLERANCE) and all(
        np.allclose(a.channels[name], b.channels[name], atol=1e-9) for name in a.channels
    )


def repetitions(drives: Sequence[Drive]) -> list[list[int]]:
    """For each drive the indices of the other drives with the same commands."""
    return [
        [
            j
            for j, other in enumerate(drives)
            if j != i
            and drive.commands is not None
            and other.commands is not None
            and other.real.sha256 != drive.real.sha256
            and same_commands(drive.commands, other.commands)
        ]
        for i, drive in enumerate(drives)
    ]


def repeatability_squares(
    drive: Drive,
    others: Sequence[Drive],
    plan: WindowPlan,
    max_delay: float,
) -> Floats:
    """Half the mean square (H, K), m^2, of the windows of a drive against each repetition of it.

    The difference of two real drives holds the variation of reality twice, that of a real and a
    simulated drive once.
    """
    assert drive.commands is not None
    repeated = []
    for other in others:
        assert other.commands is not None
        shift = float(drive.commands.time[0] - other.commands.time[0])
        real = shifted(other.real, shift)
        delay = estimate_delay(drive.real, real, plan.rate, max_delay)
        repeated.append(windows(drive.real, shifted(real, delay.seconds), plan).end ** 2)
    stacked = np.stack(repeated)
    known = np.isfinite(stacked)
    count = known.sum(axis=0)
    return np.where(count > 0, np.nansum(stacked, axis=0) / np.maximum(2 * count, 1), np.nan)
