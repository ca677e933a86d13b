"""Intervals under dependence: estimates, coverage, refusals, verdicts."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bench.simulated_errors import Process
from s2rstore import intervals
from s2rstore.intervals import Interval, verdict
from s2rstore.intervals.dependence import between_spread, midranks, series_spread
from s2rstore.intervals.sequential import BASELINE, YEAR, change_alarm
from s2rstore.metrics.recall import skill

REPEATS = 300
Floats = np.ndarray


def series(seed: int, n: int, rho: float = 0.5) -> Floats:
    return Process("lognormal", n, rho).draw(np.random.default_rng(seed), 1)[0]


@given(st.integers(0, 10_000), st.integers(9, 80), st.booleans())
def test_estimates_equal_numpy_and_scipy(seed: int, n: int, ties: bool) -> None:
    a, b = series(seed, n), series(seed + 1, n)
    a, b = (np.ceil(5 * a), np.ceil(5 * b)) if ties else (a, b)
    assert np.array_equal(midranks(a), stats.rankdata(a))
    assert intervals.mean(a).value == pytest.approx(a.mean())
    assert intervals.quantile(a, 0.9).value == pytest.approx(np.quantile(a, 0.9))
    assert intervals.proportion(a > 1).value == pytest.approx((a > 1).mean())
    expected = stats.spearmanr(a, b).statistic if np.ptp(a) and np.ptp(b) else np.nan
    assert intervals.spearman(a, b).value == pytest.approx(expected, nan_ok=True)


@given(st.integers(0, 10_000), st.integers(200, 260), st.integers(1, 4))
def test_intervals_follow_a_change_of_units(seed: int, n: int, trajectories: int) -> None:
    values, codes = series(seed, n), np.arange(n) * trajectories // n
    for estimate in (intervals.mean, intervals.median, intervals.paired_difference):
        metres, millimetres = estimate(values, codes), estimate(1000 * values, codes)
        assert metres.low <= metres.value <= metres.high
        assert millimetres.low == pytest.approx(1000 * metres.low)
        assert millimetres.high == pytest.approx(1000 * metres.high)
        assert metres.scaled(1000).high == pytest.approx(millimetres.high)
    logs = intervals.median(np.log(values), codes)
    assert np.exp(logs.high) == pytest.approx(intervals.median(values, codes).high)


DEGENERATE = (0.0, 1.0, np.nan, np.inf, 1e300, 1e-300)


@pytest.mark.filterwarnings("error")
@given(st.sampled_from([0, 1, 2, 25, 100, 250]), st.sampled_from(DEGENERATE),
       st.sampled_from(DEGENERATE), st.integers(1, 4))  # fmt: skip
def test_degenerate_values_have_bounds_in_order_or_a_reason(n, first, other, trajectories) -> None:
    values, codes = np.full(n, first), np.arange(n) * trajectories // max(n, 1)
    values[n // 3 :] = other * np.linspace(0.5, 1, n - n // 3)
    estimates = (intervals.mean, intervals.median, intervals.paired_difference,
                 lambda v, c: intervals.ratio_of_means(v, abs(v), c))  # fmt: skip
    found = [estimate(values, codes) for estimate in estimates]
    found += [intervals.proportion(values >= 1, codes), intervals.spearman(values, values, codes)]
    for interval in found:
        if interval.reason:
            assert math.isnan(interval.low)
            assert math.isnan(interval.high)
        else:
            assert interval.low <= interval.value <= interval.high


Case = tuple[Callable[[Process, Floats], Interval], Callable[[Process], float]]
CASES: dict[str, Case] = {
    "mean": (lambda p, y: intervals.mean(y, p.codes), Process.mean),
    "median": (lambda p, y: intervals.median(y, p.codes), lambda p: p.quantile(0.5)),
    "proportion": (
        lambda p, y: intervals.proportion(y <= p.quantile(0.8), p.codes, errors=y),
        lambda p: 0.8,
    ),
    "skill": (
        lambda p, y: skill(y, np.full(y.size, 3.0), p.codes),
        lambda p: 1 - p.mean() / 3,
    ),
    "ratio of means": (
        lambda p, y: intervals.ratio_of_means(y, np.roll(y[::-1], 50), p.codes),
        lambda p: 1.0,
    ),
}


@pytest.mark.parametrize("quantity", CASES)
@pytest.mark.parametrize(
    "process", [Process("lognormal", 100, 0.6), Process("lognormal", 200, 0.0, 4, 0.4)]
)
def test_the_truth_is_covered_under_dependence(quantity: str, process: Process) -> None:
    """A block bootstrap covers the first in 83 to 90 %, the second in 64 to 77 %."""
    estimate, truth = CASES[quantity]
    drawn = process.draw(np.random.default_rng(3), REPEATS)
    found = [estimate(process, values) for values in drawn]
    assert np.mean([each.low <= truth(process) <= each.high for each in found]) >= 0.92


def test_the_mean_of_skewed_units_is_covered() -> None:
    """Student's interval of the jackknife covers .87."""
    hits, units = 0, 12
    for values in np.random.default_rng(4).lognormal(0, 0.9, (REPEATS, units)):
        left_out = (values.sum() - values) / (units - 1)
        found = intervals.of_units(float(values.mean()), left_out)
        hits += found.low <= np.exp(0.9**2 / 2) <= found.high
    assert hits / REPEATS >= 0.9
    for others in (2.0, 0.0):
        equal = intervals.of_units(2.0, np.full(units, others), unit="drives")
        assert equal.reason == f"all {units} drives give the same value"


numbers = st.floats(-1e6, 1e6).map(lambda x: round(x, 6) + 0.0)
known = st.builds(
    lambda value, below, above: Interval(value - below, value, value + above),
    numbers,
    st.one_of(st.integers(0, 9), st.just(math.inf)),
    st.one_of(st.integers(0, 9), st.just(math.inf)),
)
unbounded_above = st.just(Interval(math.inf, math.inf, math.inf))
unknown = st.builds(Interval.unknown, st.one_of(st.just(math.nan), numbers), st.text("a1, b"))


@given(st.one_of(known, unbounded_above, unknown))
def test_what_is_written_as_json_or_columns_is_read_again(interval: Interval) -> None:
    """Infinite bounds included, which are null there for a stated reason."""
    data = json.loads(json.dumps(interval.as_json(), allow_nan=False))
    row = json.loads(json.dumps(interval.as_columns("gap"), allow_nan=False))
    for found in (Interval.from_json(data), Interval.from_columns(row, "gap")):
        expected = (interval.low, interval.value, interval.high)
        assert (found.low, found.value, found.high) == pytest.approx(
            expected, abs=2e-6, nan_ok=True
        )
        assert found.reason == interval.reason
    if interval.is_known and not np.isfinite([interval.low, interval.high]).all():
        assert data["reason"] == row["gap_reason"]
        assert data["reason"]


def test_a_bound_above_all_values_is_marked_as_such() -> None:
    above = Interval(math.inf, math.inf, math.inf, ends=(0.5, 4.0))
    assert above.bounds_text() == ">4.00 to >4.00"
    assert Interval.unknown(1.2, "n 7, a median needs 25").with_bounds() == (
        "1.20 (no interval: n 7, a median needs 25)"
    )
    assert Interval(0.8, 1.2, math.inf, ends=(0.5, 4.0)).with_bounds() == "1.20 (0.80 .. >4.00)"


def test_independent_values_have_nearly_their_own_intervals() -> None:
    values = np.random.default_rng(1).normal(size=(40, 400))
    widths = [found.high - found.low for found in map(intervals.mean, values)]
    assert np.median(widths) == pytest.approx(2 * 1.96 / 20, rel=0.2)
    found = intervals.mean(values[0])
    assert found.sample.effective_n > 100
    alike = intervals.mean(np.repeat(values[0][:40], 10))
    assert alike.sample.effective_n < 60
    assert alike.text.startswith("n 400, about ")


def test_too_few_or_equal_values_have_a_reason_instead_of_bounds() -> None:
    values = series(2, 48)
    for found, reason in (
        (intervals.mean(values), "n 48, a mean needs 100"),
        (intervals.median(values[:24]), "n 24, a median needs 25"),
        (intervals.proportion(values[:8] > 1), "n 8, a share needs 9"),
        (intervals.spearman(values[:8], -values[:8]), "n 8, a correlation needs 9"),
        (intervals.mean(np.full(100, 2.0)), "all values are equal"),
    ):
        assert (found.is_known, found.reason) == (False, reason)
        assert np.isnan([found.low, found.high]).all()
        assert not found.excludes_zero
        assert np.isfinite(found.value)
    assert np.isnan(intervals.mean(np.zeros(0)).value)
    assert intervals.paired_difference(np.zeros(60)) == Interval(
        0.0, 0.0, 0.0, sample=intervals.Sample(60, 60, 1)
    )


def test_unknown_values_are_left_out_and_failures_are_not() -> None:
    values = series(4, 200)
    gaps = np.insert(values, 50, np.nan)
    assert intervals.mean(gaps) == intervals.mean(values)
    hits = np.append(values < 1, [False] * 100)
    failed = intervals.proportion(hits, errors=np.append(values, [np.nan] * 100))
    assert failed.value == pytest.approx((values < 1).sum() / 300)
    none, is_large = np.zeros(values.size, dtype=np.bool_), values > 2
    lost, large = (np.where(is_large, each, values) for each in (np.nan, 1e9))
    assert intervals.proportion(none, errors=lost) == intervals.proportion(none, errors=large)


def test_the_spread_of_a_series_is_that_of_its_lowest_cosines() -> None:
    n, rho, count = 400, 0.7, 10
    values, places = series(7, n, rho), np.pi * (np.arange(n) + 0.5) / n
    squares = []
    for number in range(1, count + 1):
        weight = np.sqrt(2) * (values * np.cos(number * places)).sum()
        noise = 1 - 2 * rho * np.cos(np.pi * number / n) + rho**2
        squares.append(weight**2 * noise / (1 - rho) ** 2)
    found = series_spread(values, rho)
    assert found.error == pytest.approx(np.sqrt(np.mean(squares)) / n)
    assert found.freedom == count


def test_the_spread_between_recordings_is_that_of_clusters() -> None:
    codes = np.repeat([0, 1, 2], [20, 30, 70])
    values, error = series(9, codes.size) + codes, 0.0
    for code in range(3):
        part = values[codes == code]
        share = part.size / values.size
        error += (share * (part.mean() - values.mean())) ** 2 / (1 - share)
    assert between_spread(values, codes).error == pytest.approx(np.sqrt(error))


def test_a_share_of_few_recordings_has_the_quantile_of_few() -> None:
    none, codes = np.zeros(120, dtype=np.bool_), np.repeat([0, 1, 2], 40)
    t = between_spread(none.astype(np.float64), codes).critical(0.95)
    assert t > 4
    assert intervals.proportion(none, codes).high == pytest.approx(t**2 / (120 + t**2))


def test_the_median_of_recordings_that_differ_has_the_spread_between_them() -> None:
    """High and low levels in turn: neighbouring recordings hide how much they differ."""
    codes = np.repeat(np.arange(12), 20)
    values = 3.0 * (codes % 2) + series(8, codes.size, 0.0)
    below = (values <= np.median(values)).astype(np.float64)
    half = between_spread(below, codes).half_width(0.95)
    assert (values <= intervals.median(values, codes).high).mean() >= min(0.5 + half, 1.0)


def test_trajectories_must_not_be_interleaved() -> None:
    with pytest.raises(ValueError, match="must follow each other"):
        intervals.mean(series(1, 60), np.arange(60) % 2)


def test_a_bound_beyond_all_values_is_infinite_and_marked() -> None:
    values = np.sort(series(5, 30, 0.0))
    found = intervals.median(values)
    assert (found.low, found.high) == (-np.inf, np.inf)
    assert f"{found.bounds[0]:.2f} {found.bounds[1]:.2f}" == f"<{values[0]:.2f} >{values[-1]:.2f}"
    assert not found.excludes_zero


def test_many_values_have_the_interval_of_their_sums() -> None:
    """Long series are shortened before they are transformed; the spread stays."""
    values = series(6, 60_000, 0.6)
    halves = [intervals.mean(part) for part in np.split(values, 2)]
    whole = intervals.mean(values)
    width = np.mean([half.high - half.low for half in halves])
    assert whole.high - whole.low == pytest.approx(width / np.sqrt(2), rel=0.15)


def normal(value: float, error: float) -> verdict.Bounds:
    def bounds(level: float) -> Interval:
        half = stats.norm.ppf(0.5 + level / 2) * error
        return Interval(value - half, value, value + half, level)

    return bounds


@pytest.mark.parametrize("count", [1, 2, 4])
def test_quantities_on_their_thresholds_fail_as_rarely_as_one(count: int) -> None:
    rng, outcomes = np.random.default_rng(count), []
    for _ in range(4000):
        values = rng.normal(size=count)
        quantities = {str(k): normal(value, 1.0) for k, value in enumerate(values)}
        outcomes.append(verdict.judge(quantities, dict.fromkeys(quantities, 0.0)).outcome)
    assert outcomes.count("FAIL") / 4000 <= 0.033
    assert outcomes.count("PASS") / 4000 <= 0.033


def test_one_quantity_decides_and_is_named() -> None:
    thresholds = {"a": 1.0, "b": 1.0}
    low, wide, high = normal(0.0, 0.1), normal(0.9, 0.2), normal(3.0, 0.1)
    for second, expected in (
        (low, verdict.Judgement("PASS", ())),
        (wide, verdict.Judgement("INCONCLUSIVE", ("b",))),
        (high, verdict.Judgement("FAIL", ("b",))),
    ):
        assert verdict.judge({"a": low, "b": second}, thresholds) == expected
    unknown = partial(Interval.unknown, 0.0)
    assert verdict.judge({"a": low, "b": lambda level: unknown()}, thresholds).deciding == ("b",)
    assert verdict.judge({}, {}).outcome == "INCONCLUSIVE"


def test_the_largest_of_several_is_not_taken_for_the_one_that_is_largest_by_chance() -> None:
    rng, hits = np.random.default_rng(9), 0
    for _ in range(1000):
        found = verdict.largest([normal(value, 1.0) for value in rng.normal(size=8)])
        hits += found.low <= 0.0 <= found.high
    assert hits / 1000 >= 0.93


def test_a_year_without_change_has_no_alarm_and_a_rise_has_one() -> None:
    rng = np.random.default_rng(3)
    quiet = [change_alarm(rng.normal(1, 0.15, YEAR), 0.3).outcome for _ in range(200)]
    assert quiet.count("FAIL") <= 0.05 * 200
    for _ in range(20):
        nights = rng.normal(1, 0.15, BASELINE + 20)
        nights[BASELINE:] += 0.3
        found = change_alarm(nights, 0.3)
        assert found.outcome == "FAIL"
        assert BASELINE <= (found.since or 0) < BASELINE + 10
        mended = np.concatenate([nights, rng.normal(1, 0.15, 40)])
        assert change_alarm(mended, 0.3).outcome == "PASS"


def test_an_alarm_needs_a_baseline_and_a_constant_one_counts_no_trifle() -> None:
    assert change_alarm(np.ones(BASELINE), 0.3).outcome == "INCONCLUSIVE"
    constant = np.ones(BASELINE + 5)
    assert change_alarm(constant + np.arange(BASELINE + 5) * 1e-6, 0.3).outcome == "PASS"
    constant[BASELINE:] = 1.3
    assert change_alarm(constant, 0.3).outcome == "FAIL"
    constant[BASELINE:] = math.inf
    assert change_alarm(constant, 0.3).outcome == "FAIL"
    assert change_alarm(np.full(BASELINE + 5, math.inf), 0.3).outcome == "INCONCLUSIVE"
    with pytest.raises(ValueError, match="positive"):
        change_alarm(constant, 0.0)


def test_a_difference_with_an_estimate_without_bounds_has_none():
    """Also where the other estimate has no upper bound."""
    few = intervals.median(np.arange(14.0), np.zeros(14, dtype=int))
    many = replace(intervals.median(np.arange(60.0), np.zeros(60, dtype=int)), high=math.inf)
    for difference in (intervals.difference_of(few, many), intervals.difference_of(many, few)):
        assert not difference.is_known
        assert difference.reason == "n 14, a median needs 25"
