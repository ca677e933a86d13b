"""Coverage and width of every interval of `s2rstore.intervals`, on simulated errors of known truth.

A row is one quantity on one process: its coverage at nominal 95 % where an interval is printed, the
share of refusals, the share of bounds that are infinite, and the median width, for a mean in the
widths of the interval of as many independent values. The last quantity is the conformal radius of
`s2rstore.metrics.uncertainty` at nominal 90 %: how often it holds an error of a further visit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from bench.budget import BudgetRow
from bench.simulated_errors import Floats, Process
from s2rstore import intervals
from s2rstore.intervals import Interval
from s2rstore.metrics.uncertainty import ALPHA, conformal_radius
from s2rtools.gap.task.rank_consistency import regret

REPEATS = 1000
LIMIT = 0.93
"""Least coverage at nominal 95 %."""
RADIUS_LIMIT = 0.88
"""Least coverage of a radius at nominal 90 %."""
RADIUS = "conformal radius"
_GROUPS = 8
_EXCESS = 0.5
"""Real error of the chosen run above that of the others, of which it is the regret."""
Codes = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Coverage:
    """Result of one quantity on one process; `coverage` and `width` are NaN where all are refused.

    relative_width: median width in widths of the interval of n independent values; means alone.
    """

    quantity: str
    errors: str
    n: int
    rho: float
    trajectories: int
    icc: float
    coverage: float
    refused: float
    open: float
    width: float
    relative_width: float


Measured = Callable[[Process, np.random.Generator, int], Iterator[tuple[Interval, float, float]]]
"""Yields an interval, the truth, and the width for independent values (NaN for none)."""


def _of_values(
    estimate: Callable[[Process, Floats], Interval], truth: Callable[[Process], float]
) -> Measured:
    def measured(
        process: Process, rng: np.random.Generator, repeats: int
    ) -> Iterator[tuple[Interval, float, float]]:
        true = truth(process)
        for values in process.draw(rng, repeats):
            plain = 2 * 1.96 * values.std(ddof=1) / np.sqrt(process.n)
            yield estimate(process, values), true, plain

    return measured


def _of_pairs(
    estimate: Callable[[Process, Floats, Floats], Interval], truth: Callable[[Process], float]
) -> Measured:
    """Two series of equal distribution that share half of their latent variance."""

    def measured(
        process: Process, rng: np.random.Generator, repeats: int
    ) -> Iterator[tuple[Interval, float, float]]:
        true = truth(process)
        shared, one, two = (process.latent(rng, repeats) for _ in range(3))
        for a, b in zip((shared + one) / np.sqrt(2), (shared + two) / np.sqrt(2), strict=True):
            yield estimate(process, process.values(a), process.values(b)), true, np.nan

    return measured


def _mean_of_units(process: Process, values: Floats) -> Interval:
    """The mean by its values without each trajectory."""
    if process.trajectories < intervals.FEWEST_TRAJECTORIES:
        return Interval.unknown(reason="too few trajectories")
    sums, sizes = (np.bincount(process.codes, each) for each in (values, None))
    left_out = (values.sum() - sums) / (process.n - sizes)
    return intervals.of_units(float(values.mean()), left_out, unit="trajectories")


def _linear(process: Process, a: Floats, b: Floats) -> Interval:
    return intervals.linear(float((a - b).mean()), a - b, process.codes)


def _ratio(process: Process, a: Floats, b: Floats) -> Interval:
    """As the skill and the relative drop."""
    return intervals.ratio_of_means(process.positive(a), process.positive(b), process.codes)


def _regret(process: Process, a: Floats, b: Floats) -> Interval:
    """The first of three runs is the best but for an excess; the third mixes both others."""
    runs = np.stack([a + _EXCESS, b, np.where(np.arange(process.n) % 2, a, b)], axis=1)
    return regret(runs, 0, process.codes, intervals.LEVEL)


def _limit(process: Process) -> float:
    return process.quantile(0.85)


def _worst_group(process: Process, values: Floats) -> Interval:
    """The largest difference of a group of neighbours from all others; every true one is 0."""
    level = intervals.simultaneous_level(_GROUPS)
    groups = np.arange(process.n) * _GROUPS // process.n
    found = []
    for group in range(_GROUPS):
        inside = groups == group
        parts = (
            intervals.median(values[rows], process.codes[rows], level=level)
            for rows in (inside, ~inside)
        )
        found.append(intervals.difference_of(*parts))
    return max(found, key=lambda interval: np.nan_to_num(interval.low, nan=-np.inf))


def _radius(
    process: Process, rng: np.random.Generator, repeats: int
) -> Iterator[tuple[Interval, float, float]]:
    """The radius of all visits but one, and an error of that one; visits have random lengths."""
    starts = np.searchsorted(process.codes, np.arange(process.trajectories))
    places = np.arange(process.n) - starts[process.codes]
    for values in process.draw(rng, repeats):
        lengths = rng.integers(1, process.n // process.trajectories, process.trajectories) + 1
        seen = (places < lengths[process.codes]) & (process.codes > 0)
        found = conformal_radius(values[seen], process.codes[seen])
        further = float(values[rng.integers(lengths[0])])
        low = np.nan if found.reason else 0.0  # errors are not below 0
        yield Interval(low, found.value, found.value, 1 - ALPHA, found.reason), further, np.nan


QUANTITIES: dict[str, Measured] = {
    "mean": _of_values(lambda p, y: intervals.mean(y, p.codes), Process.mean),
    "median": _of_values(lambda p, y: intervals.median(y, p.codes), lambda p: p.quantile(0.5)),
    "quantile .9": _of_values(
        lambda p, y: intervals.quantile(y, 0.9, p.codes), lambda p: p.quantile(0.9)
    ),
    "proportion": _of_values(
        lambda p, y: intervals.proportion(y <= _limit(p), p.codes, errors=y),
        lambda p: p.share_below(_limit(p)),
    ),
    "proportion without errors": _of_values(
        lambda p, y: intervals.proportion(y <= _limit(p), p.codes),
        lambda p: p.share_below(_limit(p)),
    ),
    "paired difference": _of_pairs(
        lambda p, a, b: intervals.paired_difference(a - b, p.codes), lambda p: 0.0
    ),
    "median of paired differences": _of_pairs(
        lambda p, a, b: intervals.median(a - b, p.codes), lambda p: 0.0
    ),
    "rank correlation": _of_pairs(
        lambda p, a, b: intervals.spearman(a, b, p.codes),
        lambda p: 6 / np.pi * float(np.arcsin(0.25)),
    ),
    "linear statistic": _of_pairs(_linear, lambda p: 0.0),
    "mean of trajectories": _of_values(_mean_of_units, Process.mean),
    "ratio of means": _of_pairs(_ratio, lambda p: 1.0),
    "regret": _of_pairs(_regret, lambda p: _EXCESS),
    "worst of 8 groups": _of_values(_worst_group, lambda p: 0.0),
    RADIUS: _radius,
}


def processes() -> list[Process]:
    """One trajectory of 9 to 400 instances, and 3 to 12 trajectories with levels of their own."""
    errors, rhos = ("lognormal", "bursts", "normal"), (0.0, 0.3, 0.6, 0.8)
    single = [
        Process(kind, n, rho) for kind, n, rho in product(errors, (9, 25, 49, 100, 196, 400), rhos)
    ]
    several = [
        Process(kind, n, rho, count, icc)
        for kind, (n, count), rho, icc in product(
            errors, ((100, 3), (200, 6), (240, 12)), rhos, (0.0, 0.2, 0.4)
        )
    ]
    return single + several


def visit_processes() -> list[Process]:
    """The visits of a radius, 9 to 60 of up to 20 images, and one further visit.

    The coverage depends on the ranks of the errors alone, so one distribution is enough.
    """
    return [
        Process("lognormal", 20 * (visits + 1), rho, visits + 1, icc)
        for visits, rho, icc in product((9, 15, 30, 60), (0.0, 0.8), (0.0, 0.4))
    ]


def coverage(quantity: str, process: Process, repeats: int = REPEATS, seed: int = 1) -> Coverage:
    """Measure one quantity on one process."""
    rng = np.random.default_rng(seed)
    found = list(QUANTITIES[quantity](process, rng, repeats))
    known = [(interval, truth, plain) for interval, truth, plain in found if interval.is_known]
    hits = [interval.low <= truth <= interval.high for interval, truth, _ in known]
    widths = np.array([interval.high - interval.low for interval, _, _ in known])
    plain = np.array([width for _, _, width in known])
    return Coverage(
        quantity,
        **asdict(process),
        coverage=float(np.mean(hits)) if hits else np.nan,
        refused=1 - len(known) / repeats,
        open=float(np.isinf(widths).mean()) if known else np.nan,
        width=float(np.median(widths)) if known else np.nan,
        relative_width=float(np.median(widths) / plain.mean()) if known else np.nan,
    )  # fmt: skip


def figures(repeats: int) -> Iterator[BudgetRow]:
    """Coverage of every quantity on every process where an interval is printed.

    The limit allows for one Monte-Carlo error.
    """
    for quantity in QUANTITIES:
        limit = RADIUS_LIMIT if quantity == RADIUS else LIMIT
        for process in visit_processes() if quantity == RADIUS else processes():
            found = coverage(quantity, process, repeats)
            if found.refused < 1:
                name = f"{quantity}: {process}"
                error = float(np.sqrt(limit * (1 - limit) / (repeats * (1 - found.refused))))
                yield BudgetRow(
                    name, found.coverage, "coverage", limit - error, "at least", asdict(found)
                )
