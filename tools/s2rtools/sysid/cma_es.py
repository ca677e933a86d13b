"""Global search by CMA-ES over normalised parameters."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from s2rtools.sysid.simulators.simulator import Floats

Advance = Callable[[int], None]
"""Receives the number of new evaluations; the sum is the permitted number."""


def minimize(
    cost: Callable[[Floats], float], start: Floats, rng: np.random.Generator, evaluations: int,
    spread: float, advance: Advance,
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """Evaluations and best costs after each generation, and the best point in the unit cube."""
    import cma

    options = {
        "bounds": [0.0, 1.0], "maxfevals": evaluations, "verbose": -10, "verb_log": 0,
        "tolx": 1e-4, "tolfun": 1e-4, "tolfunhist": 1e-4,
        "seed": np.nan, "randn": lambda *shape: rng.standard_normal(shape),
    }  # fmt: skip
    strategy = cma.CMAEvolutionStrategy(start, spread, options)
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
