"""Intervals with simulation, exchange rates and plans, on simulated errors of known truth.

Real and sim errors share a part of their latent variance. A row of coverage has the median width in
that of the real images alone, the median predicted exchange rate, and the realised one: the
variance of the real estimates in that of the estimates with simulation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import product

import numpy as np

from bench.budget import BudgetRow
from bench.simulated_errors import Floats, Process
from s2rstore import intervals
from s2rstore.intervals import simulation
from s2rstore.intervals.simulation import Simulated, WithSimulation
from s2rstore.metrics.more_images import decided, images_to_decide

LIMIT = 0.93
"""Least coverage at nominal 95 %."""
WIDEST = 1.02
"""Largest mean width in that of the real images alone."""
CORRELATIONS = (0.0, 0.15, 0.5, 0.8)
"""Shares of the latent variance that real and sim errors have in common."""
_SIMULATED = 5000
_POWERS = (0.5, 0.8, 0.9)

Estimate = Callable[[Process, Floats, Floats, Floats], WithSimulation]


def _share(process: Process, real: Floats, sim: Floats, drawn: Floats) -> WithSimulation:
    limit = process.quantile(0.6)
    hits = Simulated((drawn < limit).astype(np.float64))
    return simulation.proportion(real < limit, sim < limit, hits, process.codes, errors=real)


ESTIMATES: dict[str, tuple[Estimate, Callable[[Process], float]]] = {
    "mean": (
        lambda p, real, sim, drawn: simulation.mean(real, sim, Simulated(drawn), p.codes),
        Process.mean,
    ),
    "median": (
        lambda p, real, sim, drawn: simulation.median(real, sim, Simulated(drawn), p.codes),
        lambda p: p.quantile(0.5),
    ),
    "proportion": (_share, lambda p: p.share_below(p.quantile(0.6))),
}


def processes() -> list[Process]:
    """100 to 400 real images of 1 to 12 visits."""
    shapes = ((100, 0.3, 1, 0.0), (200, 0.6, 2, 0.0), (200, 0.3, 6, 0.2), (400, 0.6, 12, 0.4))
    return [Process(errors, *shape) for errors, shape in product(("lognormal", "bursts"), shapes)]


def draw(
    process: Process, correlation: float, repeats: int, rng: np.random.Generator
) -> tuple[Floats, Floats, Floats]:
    """Real and sim errors (repeats, n), and those of simulated instances (repeats, N)."""
    shared, one, two = (process.latent(rng, repeats) for _ in range(3))
    a, b = math.sqrt(correlation), math.sqrt(1 - correlation)
    drawn = Process(process.errors, _SIMULATED, 0.0).draw(rng, repeats)
    return process.values(a * shared + b * one), process.values(a * shared + b * two), drawn


def figures(repeats: int) -> Iterator[BudgetRow]:
    """Coverage and width of every quantity, process and correlation; the power that plans keep."""
    error = float(np.sqrt(LIMIT * (1 - LIMIT) / repeats))
    for process, correlation in product(processes(), CORRELATIONS):
        drawn = list(
            zip(*draw(process, correlation, repeats, np.random.default_rng(1)), strict=True)
        )
        for name, (estimate, truth) in ESTIMATES.items():
            found = [estimate(process, *each) for each in drawn]
            known = [each for each in found if each.combined.is_known]
            if not known:
                continue
            hits = [each.combined.low <= truth(process) <= each.combined.high for each in known]
            title = f"{name}, shared {correlation:g}: {process}"
            yield BudgetRow(f"{title}: coverage", float(np.mean(hits)), "coverage",
                            LIMIT - error, "at least", _details(known, repeats))  # fmt: skip
            yield BudgetRow(f"{title}: width", _width(known), "ratio", WIDEST)
    for power in _POWERS:
        yield _kept_power(power, repeats)


def _width(found: list[WithSimulation]) -> float:
    """Mean width with simulation in that of the real images alone, of bounded intervals."""
    ratios = [
        (each.combined.high - each.combined.low) / (each.real_only.high - each.real_only.low)
        for each in found
    ]
    return float(np.mean([ratio for ratio in ratios if 0 < ratio < math.inf]))


def _details(found: list[WithSimulation], repeats: int) -> dict[str, float]:
    alone, combined = (
        np.var([getattr(each, name).value for each in found]) for name in ("real_only", "combined")
    )
    return {
        "refused": 1 - len(found) / repeats,
        "rate": float(np.median([each.rate.value for each in found])),
        "realised_rate": float(alone / combined),
    }


def _kept_power(power: float, repeats: int) -> BudgetRow:
    """The share of planned studies that decide, where the difference is anything within reach."""
    rng = np.random.default_rng(3)
    process = Process("normal", 100, 0.3)
    outcomes, promised = [], []
    while len(outcomes) < repeats:
        difference = rng.uniform(-1.0, 1.0)
        pilot = difference + process.draw(rng, 1)[0]
        interval = intervals.paired_difference(pilot)
        plan = images_to_decide(interval, power)
        if plan.reason or not plan.images:
            continue
        further = Process("normal", plan.images, 0.3).draw(rng, 1)[0] + difference
        every = intervals.paired_difference(np.concatenate([pilot, further]))
        outcomes.append(every.excludes_zero)
        promised.append(decided(interval, 1 + plan.images / process.n))
    kept, expected = float(np.mean(outcomes)), float(np.mean(promised))
    title = f"power of plans for {power:g}: distance from what they promise"
    return BudgetRow(title, abs(kept - expected), "share", 0.05, details={"kept": kept})
