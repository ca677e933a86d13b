"""Least squares from a good start: the simulator's solver if it has one, then a trust region.

The trust region fits all parameters together, because the latency is correlated with the others.
"""

from __future__ import annotations

import numpy as np

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
        before, cube = cube, _local_optimum(problem, cube)
        if len(problem) * (problem.cost(before) - problem.cost(cube)) < _MIN_GAIN:
            break
    return problem.restarted(cube), cube


def _local_optimum(problem: PredictionError, cube: Floats) -> Floats:
    """A local optimum near `cube` (p,), never worse than `cube`."""
    from scipy.optimize import least_squares

    def flat(point: Floats) -> Floats:
        return problem.residuals(point).ravel()

    def slope(point: Floats) -> Floats:
        return problem.jacobian(point).reshape(-1, len(point))

    inside = np.clip(_simulator_fit(problem, cube), 1e-9, 1 - 1e-9)
    better = least_squares(flat, inside, slope, bounds=(0.0, 1.0), x_scale="jac",
                           xtol=1e-7, ftol=1e-7, gtol=1e-10, max_nfev=25).x  # fmt: skip
    return better if problem.cost(better) <= problem.cost(cube) else cube


def _simulator_fit(problem: PredictionError, cube: Floats) -> Floats:
    """The simulator's least squares for smooth parameters, then CMA-ES for the others.

    Returns `cube` (p,) unchanged if the simulator has no solver.
    """
    smooth = np.array([one.smooth for one in problem.space.parameters])

    def residual(columns: Floats) -> Floats:
        points = np.repeat(cube[:, None], columns.shape[1], axis=1)
        points[smooth] = columns
        return np.stack([problem.residuals(point).ravel() for point in points.T], axis=1)

    better = problem.space.simulator.polish(residual, cube[smooth], smooth)
    if better is None:
        return cube
    best = cube.copy()
    best[smooth] = better
    if smooth.all():
        return best

    def cost(rough: Floats) -> float:
        point = best.copy()
        point[~smooth] = rough
        return problem.cost(point)

    rng, start = np.random.default_rng(0), best[~smooth]
    *_, end = minimize(cost, start, rng, _DELAY_EVALUATIONS, _DELAY_SPREAD, lambda _: None)
    best[~smooth] = end
    return best
