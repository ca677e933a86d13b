"""False and right outcomes of the gate and of a year of nights, on simulated errors.

Axes are means of independent processes of 100 or more errors, judged as `s2r gap` judges them. A
false FAIL is one though no axis lies above its threshold, a false PASS one though an axis lies on
it. Nights are means of 100 errors with a level of their own each night, of one or more axes that
share the budget of false alarms as in `s2r nightly`.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from bench.budget import BudgetRow
from bench.simulated_errors import Floats, Process
from s2rstore import intervals
from s2rstore.intervals.sequential import BASELINE, YEAR, change_alarm
from s2rstore.intervals.verdict import Bounds, Outcome, judge

REPEATS = 1000
LIMIT = 0.06
"""Largest share of false outcomes of single verdicts at level 95 %."""
_AXES = (1, 2, 4)
_FAR = 0.5
"""Distance of axes that are not on their threshold, in the mean error."""
_PAIRS, _LEVEL, _SPREAD, _RISE = 100, 1.0, 0.1, 0.3
"""Of nights: instances, mean error, spread between nights, and rise, metres."""
_MOST_NIGHTS = {0.0: 10.0, 0.6: 20.0}
"""Nights until the rise of one axis is found, in the median, by the correlation of neighbours."""


def figures(repeats: int) -> Iterator[BudgetRow]:
    """Rates of single verdicts, then of years of nights."""
    for kind, n, rho in product(("normal", "lognormal", "bursts"), (100, 400), (0.0, 0.6, 0.8)):
        yield from _gate(Process(kind, n, rho), repeats)
    for rho, axes in product((0.0, 0.6, 0.8), (1, 4)):
        yield from _nights(rho, axes, max(1, repeats // 4))


def _gate(process: Process, repeats: int) -> Iterator[BudgetRow]:
    """Outcomes with 1 .. k axes on their threshold, and with all axes off it."""
    rng = np.random.default_rng(7)
    spread = float(process.draw(rng, 50).std())
    for count in _AXES:
        bounds = [_bounds(process, count, rng) for _ in range(repeats)]
        for on in range(1, count + 1):
            outcomes = _outcomes(bounds, process.mean(), [0.0] * on + [_FAR] * (count - on), spread)
            for name in ("FAIL", "PASS"):
                yield BudgetRow(
                    f"{process}: {on} of {count} axes on the threshold: {name}",
                    outcomes[name], "share", LIMIT,
                )  # fmt: skip
        for name, distance in (("PASS", _FAR), ("FAIL", -_FAR)):
            outcomes = _outcomes(bounds, process.mean(), [distance] * count, spread)
            title = f"{process}: {count} axes {_FAR:g} sd from the threshold: {name}"
            yield BudgetRow(title, outcomes[name], "share")


def _bounds(process: Process, count: int, rng: np.random.Generator) -> list[Bounds]:
    def of(values: Floats) -> Bounds:
        return lambda level: intervals.mean(values, process.codes, level=level)

    return [of(values) for values in process.draw(rng, count)]


def _outcomes(
    drawn: list[list[Bounds]], mean: float, distances: list[float], spread: float
) -> dict[Outcome, float]:
    """Shares of outcomes with thresholds at some distances from the mean, in deviations."""
    thresholds = {str(k): mean + distance * spread for k, distance in enumerate(distances)}
    found = [
        judge({str(k): each for k, each in enumerate(bounds)}, thresholds).outcome
        for bounds in drawn
    ]
    return {name: found.count(name) / len(found) for name in ("PASS", "FAIL", "INCONCLUSIVE")}


def _nights(rho: float, axes: int, years: int) -> Iterator[BudgetRow]:
    """A year of independent axes without a change, and of one axis that rises."""
    rng = np.random.default_rng(11)
    budget = (1 - intervals.LEVEL) / 2 / axes
    false = np.mean([
        any(_first_alarm(_year(rho, YEAR, rng), budget) is not None for _ in range(axes))
        for _ in range(years)
    ])  # fmt: skip
    risen = []
    for _ in range(years):
        nights = _year(rho, BASELINE + 150, rng)
        nights[BASELINE:] += _RISE
        risen.append(_first_alarm(nights, budget) or np.inf)
    name = f"nights of {_PAIRS} pairs, rho {rho:g}, {axes} axes"
    yield BudgetRow(f"{name}: unchanged years with a false FAIL", float(false), "share", 0.05)
    most = _MOST_NIGHTS.get(rho) if axes == 1 else None
    title = f"{name}: nights until +{_RISE:g} m is found"
    yield BudgetRow(title, float(np.median(risen)), "nights", most)


def _year(rho: float, nights: int, rng: np.random.Generator) -> Floats:
    """Mean errors of nights, metres."""
    process = Process("lognormal", _PAIRS, rho)
    errors = process.draw(rng, nights).mean(axis=1) * _LEVEL / process.mean()
    return np.asarray(errors + rng.normal(0, _SPREAD, nights))


def _first_alarm(nights: Floats, budget: float) -> int | None:
    """Number of nights from the end of the baseline to the first alarm; None without an alarm."""
    for count in range(BASELINE + 1, nights.size + 1):
        if change_alarm(nights[:count], _RISE, budget=budget).outcome == "FAIL":
            return count - BASELINE
    return None
