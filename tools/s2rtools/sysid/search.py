"""Search of the parameters: CMA-ES from several seeds, each refined by least squares of SciPy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from s2rtools.sysid.prediction_error import PredictionError
from s2rtools.sysid.simulators.simulator import Floats, Integers

Advance = Callable[[int], None]
"""Receives the number of new evaluations; the sum is the permitted number."""
_SPREAD = 0.25
"""Standard deviation of the first points of CMA-ES, in the unit cube."""
_MAX_SECONDS = 40.0
"""Seconds of driving that the search of one seed uses; the refinement uses all."""
_WEIGHT_ROUNDS = 2
"""Rounds of estimating the noise of positions and headings from the residuals."""


@dataclass(frozen=True, slots=True)
class SearchTrace:
    """Search of one seed: best `costs` (k,) after `evaluations` (k,) on the windows of the search,
    and the `cost` of its refined end on all windows.
    """

    seed: int
    evaluations: Floats
    costs: Floats
    cost: float


def search(problem: PredictionError, seeds: int, first_seed: int, evaluations: int,
           advance: Advance) -> tuple[PredictionError, Floats, list[SearchTrace]]:  # fmt: skip
    """Search with at most `evaluations` per seed; `advance` receives those of each generation.

    Returns the problem with the best start states and weights, the optimum (p,), and the traces.
    """
    ends, traces = [], []
    for number in range(seeds):
        rng = np.random.default_rng((first_seed, number))
        start = problem.space.start()
        if number:
            start = rng.uniform(0.2, 0.8, len(start))
        part = problem.of(problem.windows.only(_random_windows(problem, rng)))
        counts, costs, end = _minimize(part.cost, start, rng, evaluations, advance)
        refined, cube = problem.refined(end)
        ends.append((refined, cube))
        traces.append(SearchTrace(number, counts, costs, refined.cost(cube)))
    problem, cube = ends[int(np.argmin([trace.cost for trace in traces]))]
    for _ in range(_WEIGHT_ROUNDS):
        problem, cube = replace(problem, sigma=_residual_noise(problem, cube)).refined(cube)
    return problem, cube, traces


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


def _minimize(
    cost: Callable[[Floats], float], start: Floats, rng: np.random.Generator, evaluations: int,
    advance: Advance,
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """CMA-ES: evaluations and best costs after each generation, and the best point (p,)."""
    import cma

    options = {
        "bounds": [0.0, 1.0], "maxfevals": evaluations, "verbose": -10, "verb_log": 0,
        "tolx": 1e-4, "tolfun": 1e-4, "tolfunhist": 1e-4,
        "seed": np.nan, "randn": lambda *shape: rng.standard_normal(shape),
    }  # fmt: skip
    strategy = cma.CMAEvolutionStrategy(start, _SPREAD, options)
    counts, costs = [], []
    done = 0
    while not strategy.stop():
        points = strategy.ask()
        strategy.tell(points, [np.log(cost(np.asarray(point))) for point in points])
        counts.append(float(strategy.result.evaluations))
        costs.append(float(np.exp(strategy.result.fbest)))
        step = min(len(points), evaluations - done)
        if step > 0:
            advance(step)
        done += step
    if done < evaluations:
        advance(evaluations - done)
    return np.array(counts), np.array(costs), np.clip(strategy.result.xbest, 0.0, 1.0)
