"""Prediction error on held-out windows before and after identification.

Windows of one drive depend on each other, so drives are the independent units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from s2rstore.intervals import Interval, of_units
from s2rtools.sysid.prediction_error import PredictionError
from s2rtools.sysid.simulators.simulator import Floats, Integers

_MAX_HEADING_RATIO = 1.02
"""Largest ratio of heading errors after and before that counts as no worse."""
_TINY = 1e-12
"""Sum of errors in metres below which all count as equal."""


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Root mean square position (m) and heading (rad) errors of the windows.

    ratio: mean position error after the change over that before, as the geometric mean of the
    drives.
    """

    drives: int
    windows: int
    untuned: tuple[float, float]
    fitted: tuple[float, float]
    ratio: Interval

    @property
    def helps(self) -> bool:
        """Whether positions improve significantly and headings do not get worse."""
        return self.ratio.high < 1 and self.fitted[1] <= _MAX_HEADING_RATIO * self.untuned[1]

    def record(self) -> dict[str, Any]:
        """JSON data with six significant digits."""
        figures = (*self.untuned, *self.fitted)
        u0, u1, f0, f1 = (float(f"{value:.6g}") for value in figures)
        return {
            "drives": self.drives,
            "windows": self.windows,
            "untuned": {"place_m": u0, "heading_rad": u1},
            "fitted": {"place_m": f0, "heading_rad": f1},
            "position_error_ratio": self.ratio.as_json(),
            "helps": self.helps,
        }  # fmt: skip


def held_out_error(problem: PredictionError, before: Floats, after: Floats) -> HeldOut:
    """Compare two sets of normalised parameters from the same start states."""
    replays = problem.windows.replays
    errors = []
    for cube in (before, after):
        deviations = problem.predicted(cube)[:, :3] - problem.windows.poses
        squares = np.stack([(deviations[:, :2] ** 2).sum(axis=1), deviations[:, 2] ** 2], axis=1)
        counts = np.diff(replays.first)[:, None]
        errors.append(np.sqrt(np.add.reduceat(squares, replays.first[:-1]) / counts))
    return compared(errors[0], errors[1], replays.drive)


def compared(before: Floats, after: Floats, drives: Integers) -> HeldOut:
    """Compare root mean square errors (w, 2), position and heading, of two predictions.

    `drives` (w,) are the drives of the windows, which are in recording order.
    """
    ratio = _mean_ratio(before[:, 0], after[:, 0], drives)
    untuned, fitted = (np.sqrt((table**2).mean(axis=0)).tolist() for table in (before, after))
    return HeldOut(np.unique(drives).size, len(before), tuple(untuned), tuple(fitted), ratio)


def _mean_ratio(before: Floats, after: Floats, drives: Integers) -> Interval:
    """Geometric mean over the drives of the ratio of their mean errors (w,), after to before."""
    _, codes = np.unique(drives, return_inverse=True)
    sums = np.stack([np.bincount(codes, errors) for errors in (after, before)])
    logs = np.log(np.maximum(sums[0], _TINY) / np.maximum(sums[1], _TINY))
    left_out = (logs.sum() - logs) / max(logs.size - 1, 1)
    found = of_units(float(logs.mean()), left_out, unit="held-out drives")
    low, value, high = (math.exp(log) for log in (found.low, found.value, found.high))
    return replace(found, low=low, value=value, high=high)
