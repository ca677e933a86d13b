"""Bootstrap over drives for the identified parameters.

Every replicate resamples drives with replacement and refits by one Gauss-Newton step from the
optimum, using the contribution of each drive to the normal equations; near the optimum the fit is
linear to well within its error, so no simulation is needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from s2rstore.metrics.bootstrap import corrected, percentile_bounds
from s2rtools.sysid.prediction_error import PredictionError
from s2rtools.sysid.simulators.simulator import Floats

_PRIOR = 12.0
"""Prior precision of a normalised parameter: one over the variance of 0 .. 1."""


@dataclass(frozen=True, slots=True)
class NormalEquations:
    """Normal equations per drive at a point: `matrices` (d, p, p) and `vectors` (d, p); drives
    without windows are left out."""

    matrices: Floats
    vectors: Floats


def normal_equations(problem: PredictionError, cube: Floats) -> NormalEquations:
    residual, slope = problem.residuals(cube), problem.jacobian(cube)
    drives = problem.windows.drive_of_row
    matrices, vectors = [], []
    for drive in np.unique(drives):
        rows = slope[drives == drive].reshape(-1, len(cube))
        matrices.append(rows.T @ rows)
        vectors.append(rows.T @ residual[drives == drive].ravel())
    return NormalEquations(np.stack(matrices), np.stack(vectors))


def refit_replicates(
    normal: NormalEquations, cube: Floats, count: int, rng: np.random.Generator
) -> Floats:
    """Refitted normalised parameters (count, p), not clipped to [0, 1]."""
    drives = len(normal.vectors)
    counts = rng.multinomial(drives, np.full(drives, 1.0 / drives), size=count)
    matrices = np.einsum("rd,dpq->rpq", counts, normal.matrices)
    matrices += _PRIOR * np.eye(len(cube))
    vectors = counts @ normal.vectors
    return cube - np.linalg.solve(matrices, vectors[:, :, None])[:, :, 0]


def drive_interval(replicates: Floats, estimate: Floats, level: float, drives: int) -> Floats:
    """Bounds (2, p) of replicates (r, p) around an estimate (p,), corrected for few drives."""
    columns = corrected(replicates, estimate, drives, level).T
    return np.array([percentile_bounds(column, level) for column in columns]).T
