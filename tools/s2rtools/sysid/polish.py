"""Least squares from a good start: the simulator's own, else a trust region."""

from __future__ import annotations

import numpy as np

from s2rtools.sysid.problem import Problem
from s2rtools.sysid.simulators.contract import Floats

_ROUNDS, _DELAY_EVALUATIONS, _DELAY_SPREAD = 2, 24, 0.03


def polished(problem: Problem, cube: Floats) -> Floats:
    """A local optimum near `cube` (p,), never worse than it."""
    smooth = np.array([one.smooth for one in problem.space.parameters])
    found = _own(problem, cube, smooth)
    if found is None:
        found = _trust_region(problem, cube)
    return found if problem.cost(found) <= problem.cost(cube) else cube


def _trust_region(problem: Problem, cube: Floats) -> Floats:
    from scipy.optimize import least_squares

    def flat(point: Floats) -> Floats:
        return problem.residuals(point).ravel()

    def slope(point: Floats) -> Floats:
        return problem.jacobian(point).reshape(-1, len(point))

    inside = np.clip(cube, 1e-9, 1 - 1e-9)
    found = least_squares(flat, inside, slope, bounds=(0.0, 1.0), x_scale="jac",
                          xtol=1e-7, ftol=1e-7, gtol=1e-10, max_nfev=25)  # fmt: skip
    return np.asarray(found.x)


def _own(problem: Problem, cube: Floats, smooth: np.ndarray) -> Floats | None:
    """The simulator's least squares over the smooth parameters, CMA-ES over the others, in turn."""
    from s2rtools.sysid.search import minimised

    for number in range(_ROUNDS):
        fixed = cube.copy()

        def of(columns: Floats, fixed: Floats = fixed) -> Floats:
            points = np.repeat(fixed[:, None], columns.shape[1], axis=1)
            points[smooth] = columns
            return np.stack([problem.residuals(p).ravel() for p in points.T], axis=1)

        better = problem.space.simulator.polish(of, cube[smooth], smooth)
        if better is None:
            return None
        cube = cube.copy()
        cube[smooth] = better
        if not smooth.all():
            held = cube.copy()

            def cost(point: Floats, held: Floats = held) -> float:
                whole = held.copy()
                whole[~smooth] = point
                return problem.cost(whole)

            rng = np.random.default_rng(number)
            cube[~smooth] = minimised(cost, cube[~smooth], rng, _DELAY_EVALUATIONS,
                                      _DELAY_SPREAD, lambda steps: None)[2]  # fmt: skip
    return cube
