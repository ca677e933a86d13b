"""Error of prediction on held-out windows, restarted from real states: before and after.

Windows of one drive depend on each other, so the bootstrap draws drives, with limits expanded as
those of the parameters (see `intervals`). Where drives are few it also draws blocks of consecutive
windows inside each drawn drive, which widens the limits by itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from s2rstore.metrics.bootstrap import LEVEL, percentile_bounds
from s2rtools.sysid.drive_bootstrap import interval
from s2rtools.sysid.prediction_error import PredictionError
from s2rtools.sysid.simulators.simulator import Floats, Integers

_FEW = 6
"""Drives, from which on drawing them alone varies enough."""
_WORSE = 1.02
"""Times the heading's error before, from which on it got worse."""


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Root mean square over windows of the distance (m) and heading (rad) error; the mean
    `improvement` of a window's distance, in m, with its interval by bootstrap over drives.
    """

    drives: int
    windows: int
    untuned: tuple[float, float]
    fitted: tuple[float, float]
    improvement: float
    low: float
    high: float

    @property
    def helps(self) -> bool:
        """Places certainly get better and headings no worse."""
        return self.low > 0 and self.fitted[1] <= _WORSE * self.untuned[1]

    def record(self) -> dict[str, Any]:
        short = [float(f"{value:.6g}") for value in (*self.untuned, *self.fitted, self.improvement,
                                                     self.low, self.high)]  # fmt: skip
        return {
            "drives": self.drives,
            "windows": self.windows,
            "untuned": {"place_m": short[0], "heading_rad": short[1]},
            "fitted": {"place_m": short[2], "heading_rad": short[3]},
            "improvement_m": short[4], "improvement_low": short[5], "improvement_high": short[6],
            "helps": self.helps,
        }  # fmt: skip


def held_out_error(problem: PredictionError, before: Floats, after: Floats, count: int,
                   rng: np.random.Generator) -> HeldOut:  # fmt: skip
    """Of two points of the cube, both from the same start states."""
    drives = problem.windows.replays.drive
    return compared(_errors(problem, before), _errors(problem, after), drives, count, rng)


def compared(before: Floats, after: Floats, drives: Integers, count: int,
             rng: np.random.Generator) -> HeldOut:  # fmt: skip
    """Windows' root mean square errors (w, 2), place and heading, of two predictions; `drives`
    (w,) are those of the windows, which lie in the order of driving.
    """
    gain = before[:, 0] - after[:, 0]
    groups = [gain[drives == drive] for drive in np.unique(drives)]
    drawn = drawn_means(groups, count, rng)
    if len(groups) < _FEW:
        low, high = percentile_bounds(drawn)
    else:
        low, high = interval(drawn, LEVEL, len(groups))
    whole = [tuple(np.sqrt((table**2).mean(axis=0)).tolist()) for table in (before, after)]
    return HeldOut(len(groups), len(gain), whole[0], whole[1], float(gain.mean()), float(low),
                   float(high))  # fmt: skip


def drawn_means(groups: list[Floats], count: int, rng: np.random.Generator) -> Floats:
    """Means (count,) of bootstrap samples of dependent groups."""
    sizes = np.array([len(group) for group in groups])
    total, number = np.zeros(count), np.zeros(count)
    for _ in groups:
        chosen = rng.integers(0, len(groups), count)
        if len(groups) < _FEW:
            sums = np.stack([_block_sums(group, count, rng) for group in groups])
        else:
            sums = np.broadcast_to([[group.sum()] for group in groups], (len(groups), count))
        total += sums[chosen, np.arange(count)]
        number += sizes[chosen]
    return total / number


def _block_sums(values: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Sums (count,) of samples as long as `values`, of blocks that wrap round (Politis and Romano,
    1992)."""
    n = len(values)
    length = int(np.ceil(np.sqrt(n)))
    starts = rng.integers(0, n, (count, -(-n // length)))
    places = (starts[:, :, None] + np.arange(length)) % n
    return np.asarray(values[places.reshape(count, -1)[:, :n]].sum(axis=1))


def _errors(problem: PredictionError, cube: Floats) -> Floats:
    off = problem.predicted(cube)[:, :3] - problem.windows.poses
    return per_window(off, problem.windows.replays.first[:-1])


def per_window(off: Floats, first: np.ndarray) -> Floats:
    """Root mean square distance and heading error (w, 2) of rows (n, 3)."""
    squares = np.stack([off[:, 0] ** 2 + off[:, 1] ** 2, off[:, 2] ** 2], axis=1)
    counts = np.diff([*first, len(off)])[:, None]
    return np.sqrt(np.add.reduceat(squares, first) / counts)
