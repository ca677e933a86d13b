"""Least squares from a good start: the simulator's solver if it has one, then a trust region.

The trust region fits all parameters together, because the latency is correlated with the others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rtools.sysid.cma_es import minimize
from s2rtools.sysid.prediction_error import PredictionError
from s2rtools.sysid.simulators.simulator import Floats

_DELAY_EVALUATIONS, _DELAY_SPREAD = 12, 0.02


_MIN_GAIN = 0.1
"""Decrease of the sum of squares below which the rounds end."""


def refine(problem: PredictionError, cube: Floats) -> tuple[PredictionError, Floats]:
    """The optimum near `cube` (p,), and the problem with its best start states."""
    for _ in range(problem.space.simulator.rounds):
        problem = problem.restarted(cube)
        before, cube = cube, local_optimum(problem, cube)
        if len(problem) * (problem.cost(before) - problem.cost(cube)) < _MIN_GAIN:
            break
    return problem.restarted(cube), cube


def local_optimum(problem: PredictionError, cube: Floats) -> Floats:
    """A local optimum near `cube` (p,), never worse than `cube`."""
    smooth = np.array([one.smooth for one in problem.space.parameters])
    found = _simulator_fit(problem, cube, smooth)
    found = _trust_region(problem, cube if found is None else found)
    return found if problem.cost(found) <= problem.cost(cube) else cube


def _trust_region(problem: PredictionError, cube: Floats) -> Floats:
    from scipy.optimize import least_squares

    def flat(point: Floats) -> Floats:
        return problem.residuals(point).ravel()

    def slope(point: Floats) -> Floats:
        return problem.jacobian(point).reshape(-1, len(point))

    inside = np.clip(cube, 1e-9, 1 - 1e-9)
    found = least_squares(flat, inside, slope, bounds=(0.0, 1.0), x_scale="jac",
                          xtol=1e-7, ftol=1e-7, gtol=1e-10, max_nfev=25)  # fmt: skip
    return np.asarray(found.x)


def _simulator_fit(
    problem: PredictionError, cube: Floats, smooth: NDArray[np.bool_]
) -> Floats | None:
    """The simulator's least squares for smooth parameters, then CMA-ES for the others."""

    def residual(columns: Floats) -> Floats:
        points = np.repeat(cube[:, None], columns.shape[1], axis=1)
        points[smooth] = columns
        return np.stack([problem.residuals(point).ravel() for point in points.T], axis=1)

    better = problem.space.simulator.polish(residual, cube[smooth], smooth)
    if better is None:
        return None
    found = cube.copy()
    found[smooth] = better
    if not smooth.all():
        found[~smooth] = _searched(problem, found, ~smooth)
    return found


def _searched(problem: PredictionError, cube: Floats, free: NDArray[np.bool_]) -> Floats:
    def cost(point: Floats) -> float:
        whole = cube.copy()
        whole[free] = point
        return problem.cost(whole)

    rng = np.random.default_rng(0)
    return minimize(cost, cube[free], rng, _DELAY_EVALUATIONS, _DELAY_SPREAD, lambda _: None)[2]
