"""Intervals that simulated errors narrow: estimates, coverage, width, refusals."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from bench.simulated_errors import Process
from s2rstore import intervals
from s2rstore.intervals import simulation
from s2rstore.intervals.simulation import Simulated, WithSimulation

REPEATS = 150
Floats = np.ndarray


def draw(
    process: Process, correlation: float, further: int, repeats: int, seed: int = 1
) -> tuple[Floats, Floats, Floats]:
    """Real and sim errors (repeats, n) of shared latent variance, and further sim errors."""
    rng = np.random.default_rng(seed)
    shared, one, two = (process.latent(rng, repeats) for _ in range(3))
    a, b = math.sqrt(correlation), math.sqrt(1 - correlation)
    simulated = Process(process.errors, further, 0.0).draw(rng, repeats)
    return process.values(a * shared + b * one), process.values(a * shared + b * two), simulated


def median_of(process: Process, real: Floats, sim: Floats, drawn: Floats) -> WithSimulation:
    return simulation.median(real, sim, Simulated(drawn), process.codes)


def mean_of(process: Process, real: Floats, sim: Floats, drawn: Floats) -> WithSimulation:
    return simulation.mean(real, sim, Simulated(drawn), process.codes)


def share_of(process: Process, real: Floats, sim: Floats, drawn: Floats) -> WithSimulation:
    limit = process.quantile(0.6)
    hits = Simulated((drawn < limit).astype(float))
    return simulation.proportion(real < limit, sim < limit, hits, process.codes, errors=real)


TRUTHS: dict[Callable[..., WithSimulation], Callable[[Process], float]] = {
    mean_of: Process.mean,
    median_of: lambda process: process.quantile(0.5),
    share_of: lambda process: process.share_below(process.quantile(0.6)),
}


@pytest.mark.parametrize("estimate", TRUTHS, ids=lambda each: each.__name__)
@pytest.mark.parametrize(
    ("process", "correlation"),
    [(Process("lognormal", 200, 0.3, 6, 0.2), 0.8), (Process("bursts", 200, 0.6), 0.15)],
    ids=str,
)
def test_coverage_and_width(
    process: Process, correlation: float, estimate: Callable[..., WithSimulation]
) -> None:
    """Strong correlation narrows the interval, a weak one widens it by no more than noise."""
    truth, found = TRUTHS[estimate](process), []
    for real, sim, drawn in zip(*draw(process, correlation, 4000, REPEATS), strict=True):
        found.append(estimate(process, real, sim, drawn))
    held = [each.combined.low <= truth <= each.combined.high for each in found]
    assert np.mean(held) >= 0.9  # nominal .95 less the noise of so few repeats
    widths = [(each.combined.high - each.combined.low) / (each.real_only.high - each.real_only.low)
              for each in found]  # fmt: skip
    assert np.nanmean(widths) < (0.92 if correlation > 0.5 else 1.03)


def test_the_estimate_is_the_control_variate_of_the_definition() -> None:
    """With one weight for all folds the estimate is mean(real - w sim) + w mean(simulated)."""
    rng = np.random.default_rng(3)
    base = np.tile(rng.lognormal(size=40), 5)  # five equal folds have equal weights
    sim = 0.5 * base + 0.2
    drawn = rng.choice(sim, 3000)
    real = base + np.tile(rng.normal(size=40), 5)
    found = simulation.mean(real, sim, Simulated(drawn))
    square = np.corrcoef(real, sim)[0, 1] ** 2
    shrinkage = 1 - 2 / (0.8 * real.size) * (1 - square) / square
    expected = np.cov(real, sim, ddof=0)[0, 1] / sim.var() / (1 + real.size / drawn.size)
    expected *= shrinkage
    assert found.weight == pytest.approx(expected)
    value = (real - expected * sim).mean() + expected * drawn.mean()
    assert found.combined.value == pytest.approx(value)


def test_the_exchange_rate_is_that_of_the_correlation_of_independent_errors() -> None:
    process = Process("normal", 20_000, 0.0)
    real, sim, _ = (each[0] for each in draw(process, 0.8, 1, 1))
    rate = simulation.mean(real, sim, Simulated.none()).rate
    assert rate.low < 1 / (1 - 0.8**2) < rate.high
    assert rate.value == pytest.approx(1 / (1 - 0.8**2), rel=0.1)


def test_without_simulated_instances_the_interval_is_that_of_the_real_images() -> None:
    process = Process("lognormal", 200, 0.3)
    real, sim, _ = (each[0] for each in draw(process, 0.5, 1, 1))
    found = simulation.mean(real, sim, Simulated.none())
    assert found.combined == found.real_only == intervals.mean(real)
    assert found.effective_images == pytest.approx(200)


def refused(**changes: Floats) -> str:
    process = Process("lognormal", 120, 0.3)
    real, sim, drawn = (each[0] for each in draw(process, 0.5, 500, 1))
    data = {"real": real, "sim": sim, "drawn": drawn} | changes
    found = simulation.mean(data["real"], data["sim"], Simulated(data["drawn"]))
    assert not found.combined.is_known
    return found.combined.reason


def test_errors_that_fall_where_simulated_ones_rise_make_simulation_worth_nothing() -> None:
    rng = np.random.default_rng(0)
    sim = rng.gamma(2, 1, 200)
    rate = simulation.mean(sim.max() - sim + rng.gamma(2, 1, 200), sim, Simulated(sim)).rate
    assert (rate.low, rate.value, rate.high) == (1, 1, 1)


def test_what_cannot_be_estimated_is_refused_with_the_reason() -> None:
    few = np.arange(99.0)
    assert refused(real=few, sim=few) == "n 99, an interval with simulation needs 100 pairs"
    assert refused(sim=np.ones(120)) == "all simulated values are equal"
    assert refused(real=np.ones(120)) == "all real values are equal"
    assert refused(sim=np.full(120, np.nan)) == "a value is infinite or missing"
    assert "unlike those of the pairs" in refused(drawn=np.full(500, 40.0))
    with pytest.raises(ValueError, match="one shape"):
        simulation.mean(few, few[1:], Simulated.none())


def test_estimates_agree_with_those_of_ppi_python() -> None:
    """Its intervals presume independent rows; ours allow for dependence and are no narrower."""
    reference = pytest.importorskip("ppi_py")
    for correlation in (0.0, 0.6, 0.9):
        rng = np.random.default_rng(1)
        sim, drawn = rng.normal(5, 1, 1000), rng.normal(5, 1, 20_000)
        real = correlation * sim + math.sqrt(1 - correlation**2) * rng.normal(5, 1, 1000)
        low, high = (float(end[0]) for end in reference.ppi_mean_ci(real, sim, drawn, alpha=0.05))
        found = simulation.mean(real, sim, Simulated(drawn), np.arange(1000)).combined
        assert abs(found.value - (low + high) / 2) < 0.1 * (high - low)
        assert 0.95 * (high - low) < found.high - found.low < 1.6 * (high - low)
