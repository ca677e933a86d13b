"""Bootstrap over drives for the identified parameters.

Every replicate resamples drives with replacement and refits by one Gauss-Newton step from the
optimum, using the contribution of each drive to the normal equations; near the optimum the fit is
linear to well within its error, so no simulation is needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from s2rstore.metrics.bootstrap import correction_factor
from s2rtools.sysid.prediction_error import PredictionError
from s2rtools.sysid.simulators.simulator import Floats

_PRIOR = 12.0
"""Prior precision of a normalised parameter: 1 / variance of the uniform distribution on 0 .. 1."""


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


def drive_interval(replicates: Floats, level: float, drives: int) -> Floats:
    """Bounds (2, ...) of replicates (r, ...): percentiles at a level expanded for few drives.

    The normal quantile of the level is multiplied by `correction_factor`. For normal replicates
    these are the corrected bounds of `s2rstore.metrics.bootstrap`; for skewed ones they never leave
    the range of the refits. Source: Hesterberg, The American Statistician 69, 2015, section 5.3.
    """
    tail = float(ndtr(correction_factor(drives, level) * ndtri((1 - level) / 2)))
    return np.quantile(replicates, [tail, 1 - tail], axis=0)
