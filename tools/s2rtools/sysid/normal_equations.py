"""Normal equations of each drive, and the bounds of identified parameters that follow from them.

Drives are the independent units. The parameters are refitted without each drive by one Gauss-Newton
step from the optimum; near it the fit is linear to well within its error, so no simulation is
needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from s2rstore.intervals import of_units
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


def refits_without_each(normal: NormalEquations, cube: Floats) -> Floats:
    """Normalised parameters (d, p) refitted without each drive, not clipped to [0, 1]."""
    matrices = normal.matrices.sum(axis=0) - normal.matrices + _PRIOR * np.eye(len(cube))
    vectors = normal.vectors.sum(axis=0) - normal.vectors
    return np.asarray(cube - np.linalg.solve(matrices, vectors[:, :, None])[:, :, 0])


def parameter_bounds(normal: NormalEquations, cube: Floats, level: float) -> Floats:
    """Bounds (2, p) of normalised parameters at a level, around one step from `cube`.

    They exclude a value of `cube` that the normal equations would move by more than its noise.
    """
    refits = refits_without_each(normal, cube)
    intervals = [
        of_units(float(column.mean()), column, unit="drives", level=level) for column in refits.T
    ]
    return np.array([[each.low for each in intervals], [each.high for each in intervals]])
