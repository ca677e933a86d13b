"""CMA-ES over the cube of parameters, from several seeds; the best is polished by least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from s2rtools.sysid.cma_es import Advance, minimised
from s2rtools.sysid.least_squares import settled
from s2rtools.sysid.prediction_error import PredictionError
from s2rtools.sysid.simulators.simulator import Floats, Integers

_SPREAD = 0.25
_LONGEST = 40.0
"""Seconds of driving that one seed's search looks at; the polish looks at all."""
_WEIGHTED = 2
"""Rounds of taking the noise of places and headings from what the fit leaves."""


@dataclass(frozen=True, slots=True)
class Course:
    """One seed's search: the best cost so far (k,) after `evaluations` (k,), on its own windows;
    where it ended (p,), and the polished end's cost on all windows.
    """

    seed: int
    evaluations: Floats
    costs: Floats
    end: Floats
    polished: Floats
    cost: float


@dataclass(frozen=True, slots=True)
class Found:
    """The optimum `cube` (p,) and the problem whose start states and weights belong to it."""

    cube: Floats
    problem: PredictionError
    courses: tuple[Course, ...]


def search(problem: PredictionError, seeds: int, first_seed: int, evaluations: int,
           advance: Advance) -> Found:  # fmt: skip
    """`evaluations` of the objective at most per seed; `advance` hears of each generation's."""
    courses = []
    for number in range(seeds):
        rng = np.random.default_rng((first_seed, number))
        start = problem.space.start()
        if number:
            start = rng.uniform(0.2, 0.8, len(start))
        courses.append(_course(problem, start, rng, number, evaluations, advance))
    best = min(courses, key=lambda course: course.cost)
    cube = best.polished
    problem = problem.restarted(cube)
    for _ in range(_WEIGHTED):
        problem, cube = settled(problem.weighted(_left(problem, cube)), cube)
    return Found(cube, problem, tuple(courses))


def _course(problem: PredictionError, start: Floats, rng: np.random.Generator, number: int,
            evaluations: int, advance: Advance) -> Course:  # fmt: skip
    part = problem.of(problem.windows.only(_some(problem, rng)))
    counts, costs, end = minimised(part.cost, start, rng, evaluations, _SPREAD, advance)
    whole, fine = settled(problem, end)
    return Course(number, counts, costs, end, fine, whole.cost(fine))


def _some(problem: PredictionError, rng: np.random.Generator) -> Integers:
    """Windows of `_LONGEST` seconds in all, drawn without replacement."""
    count = len(problem.windows)
    keep = max(1, int(count * min(1.0, _LONGEST / problem.windows.seconds())))
    return np.sort(rng.permutation(count)[:keep])


def _left(problem: PredictionError, cube: Floats) -> Floats:
    """What the fit leaves, as standard deviation of places (x and y pooled) and headings."""
    rms = np.sqrt((problem.residuals(cube) ** 2).mean(axis=0)) * problem.sigma
    place = float(np.hypot(rms[0], rms[1]) / np.sqrt(2.0))
    return np.maximum([place, place, rms[2]], 1e-6)
