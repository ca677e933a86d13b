"""Search of the parameters: CMA-ES from several seeds, each refined by least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from s2rtools.sysid.cma_es import Advance, minimize
from s2rtools.sysid.least_squares import refine
from s2rtools.sysid.prediction_error import PredictionError
from s2rtools.sysid.simulators.simulator import Floats, Integers

_SPREAD = 0.25
_MAX_SECONDS = 40.0
"""Seconds of driving that the search of one seed uses; the refinement uses all."""
_WEIGHT_ROUNDS = 2
"""Rounds of estimating the noise of positions and headings from the residuals."""


@dataclass(frozen=True, slots=True)
class SearchTrace:
    """Search of one seed: best `costs` (k,) after `evaluations` (k,) on the windows of the search,
    the `end` (p,) of the search, the `refined` end (p,), and its `cost` on all windows.
    """

    seed: int
    evaluations: Floats
    costs: Floats
    end: Floats
    refined: Floats
    cost: float


def search(problem: PredictionError, seeds: int, first_seed: int, evaluations: int,
           advance: Advance) -> tuple[PredictionError, Floats, list[SearchTrace]]:  # fmt: skip
    """Search with at most `evaluations` per seed; `advance` receives those of each generation.

    Returns the problem with the best start states and weights, the optimum (p,), and the traces.
    """
    traces = []
    for number in range(seeds):
        rng = np.random.default_rng((first_seed, number))
        start = problem.space.start()
        if number:
            start = rng.uniform(0.2, 0.8, len(start))
        traces.append(_search_seed(problem, start, rng, number, evaluations, advance))
    best = min(traces, key=lambda trace: trace.cost)
    cube = best.refined
    problem = problem.restarted(cube)
    for _ in range(_WEIGHT_ROUNDS):
        problem, cube = refine(problem.weighted(_residual_noise(problem, cube)), cube)
    return problem, cube, traces


def _search_seed(problem: PredictionError, start: Floats, rng: np.random.Generator, number: int,
                 evaluations: int, advance: Advance) -> SearchTrace:  # fmt: skip
    part = problem.of(problem.windows.only(_random_windows(problem, rng)))
    counts, costs, end = minimize(part.cost, start, rng, evaluations, _SPREAD, advance)
    whole, fine = refine(problem, end)
    return SearchTrace(number, counts, costs, end, fine, whole.cost(fine))


def _random_windows(problem: PredictionError, rng: np.random.Generator) -> Integers:
    """Windows of together `_MAX_SECONDS` seconds, drawn without replacement."""
    count = len(problem.windows)
    size = max(1, int(count * min(1.0, _MAX_SECONDS / problem.windows.seconds())))
    return np.sort(rng.permutation(count)[:size])


def _residual_noise(problem: PredictionError, cube: Floats) -> Floats:
    """Standard deviation of the residuals of positions (x and y pooled) and headings."""
    rms = np.sqrt((problem.residuals(cube) ** 2).mean(axis=0)) * problem.sigma
    place = float(np.hypot(rms[0], rms[1]) / np.sqrt(2.0))
    return np.maximum([place, place, rms[2]], 1e-6)
