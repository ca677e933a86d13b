"""CMA-ES on the unit cube."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from s2rtools.sysid.simulators.simulator import Floats

Advance = Callable[[int], None]
"""Told of evaluations that were spent; their sum is what was granted."""


def minimised(
    cost: Callable[[Floats], float],
    start: Floats,
    rng: np.random.Generator,
    evaluations: int,
    spread: float,
    advance: Advance,
) -> tuple[Floats, Floats, Floats]:
    """CMA-ES on the unit cube: evaluations and best costs after each generation, and the best."""
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
        told = min(len(points), evaluations - done)
        if told > 0:
            advance(told)
        done += told
    if done < evaluations:
        advance(evaluations - done)
    return np.array(counts), np.array(costs), np.clip(strategy.result.xbest, 0.0, 1.0)
