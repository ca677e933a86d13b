"""Intervals by bootstrap over drives.

Every replicate draws drives with replacement and refits from the optimum by one Gauss-Newton step
on what each drive contributes to the normal equations; around the optimum the fit is linear to
well within its own error, so no replay is needed. Few drives make percentile intervals too short:
their levels are expanded as by Hesterberg (The American Statistician 69, 2015, section 5.3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from s2rtools.gap.bootstrap_correction import small_sample
from s2rtools.sysid.prediction_error import PredictionError
from s2rtools.sysid.simulators.simulator import Floats

_PRIOR = 12.0
"""Precision of a cube coordinate that nothing is known about: one over the variance of 0 .. 1."""


@dataclass(frozen=True, slots=True)
class Normal:
    """What each drive adds to the normal equations at a point: `matrices` (d, p, p), `vectors`
    (d, p), drives without windows left out."""

    matrices: Floats
    vectors: Floats


def normal_equations(problem: PredictionError, cube: Floats) -> Normal:
    residual, slope = problem.residuals(cube), problem.jacobian(cube)
    drives = problem.windows.drive_of_row
    matrices, vectors = [], []
    for drive in np.unique(drives):
        rows = slope[drives == drive].reshape(-1, len(cube))
        matrices.append(rows.T @ rows)
        vectors.append(rows.T @ residual[drives == drive].ravel())
    return Normal(np.stack(matrices), np.stack(vectors))


def replicates(normal: Normal, cube: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Refitted cube coordinates (count, p), not cut to the cube."""
    drives = len(normal.vectors)
    drawn = rng.multinomial(drives, np.full(drives, 1.0 / drives), size=count)
    matrices = np.einsum("rd,dpq->rpq", drawn, normal.matrices)
    matrices += _PRIOR * np.eye(len(cube))
    vectors = drawn @ normal.vectors
    return cube - np.linalg.solve(matrices, vectors[:, :, None])[:, :, 0]


def interval(values: Floats, level: float, drives: int) -> Floats:
    """Expanded percentile limits (2, p) of replicates (r, p) over so many drives."""
    tail = float(ndtr(small_sample(drives, level) * ndtri((1 - level) / 2)))
    return np.quantile(values, [tail, 1 - tail], axis=0)
