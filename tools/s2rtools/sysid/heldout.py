"""Error of prediction on held-out windows, restarted from real states: before and after."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from s2rtools.sysid.problem import Problem
from s2rtools.sysid.simulators.contract import Floats

_LEVEL = 0.95


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Root mean square over windows of the distance (m) and heading (rad) error; the mean
    `improvement` of a window's distance, in m, with its interval over windows.
    """

    windows: int
    untuned: tuple[float, float]
    fitted: tuple[float, float]
    improvement: float
    low: float
    high: float

    @property
    def helps(self) -> bool:
        return self.low > 0

    def record(self) -> dict[str, Any]:
        short = [float(f"{value:.6g}") for value in (*self.untuned, *self.fitted, self.improvement,
                                                     self.low, self.high)]  # fmt: skip
        return {
            "windows": self.windows,
            "untuned": {"place_m": short[0], "heading_rad": short[1]},
            "fitted": {"place_m": short[2], "heading_rad": short[3]},
            "improvement_m": short[4], "improvement_low": short[5], "improvement_high": short[6],
            "helps": self.helps,
        }  # fmt: skip


def held_out_error(problem: Problem, before: Floats, after: Floats, count: int,
                   rng: np.random.Generator) -> HeldOut:  # fmt: skip
    """Of two points of the cube, both from the same start states."""
    return compared(_errors(problem, before), _errors(problem, after), count, rng)


def compared(before: Floats, after: Floats, count: int, rng: np.random.Generator) -> HeldOut:
    """Windows' root mean square errors (w, 2), place and heading, of two predictions."""
    gain = before[:, 0] - after[:, 0]
    drawn = rng.integers(0, len(gain), (count, len(gain)))
    low, high = np.quantile(gain[drawn].mean(axis=1), [(1 - _LEVEL) / 2, (1 + _LEVEL) / 2])
    whole = [tuple(np.sqrt((table**2).mean(axis=0)).tolist()) for table in (before, after)]
    return HeldOut(len(gain), whole[0], whole[1], float(gain.mean()), float(low), float(high))


def _errors(problem: Problem, cube: Floats) -> Floats:
    off = problem.predicted(cube)[:, :3] - problem.windows.poses
    return per_window(off, problem.windows.replays.first[:-1])


def per_window(off: Floats, first: np.ndarray) -> Floats:
    """Root mean square distance and heading error (w, 2) of rows (n, 3)."""
    squares = np.stack([off[:, 0] ** 2 + off[:, 1] ** 2, off[:, 2] ** 2], axis=1)
    counts = np.diff([*first, len(off)])[:, None]
    return np.sqrt(np.add.reduceat(squares, first) / counts)
