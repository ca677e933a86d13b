"""The delay axis: time delay of reality relative to the simulator, in periods of the controller."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Literal, get_args

import numpy as np
from scipy import stats

from s2rstore.errors import RequestError
from s2rstore.intervals import LEVEL, Interval, of_units
from s2rtools.gap.axis import (
    Anchor,
    Axis,
    AxisResult,
    Details,
    Evidence,
    GapSettings,
    Parser,
    no_drives,
    number,
    one_of,
    reach,
)
from s2rtools.gap.delay import time_delay
from s2rtools.gap.dynamics.log_quality import untuned_log
from s2rtools.motion_logs.motion_log import Drive, Floats, Log

BadState = Literal["period", "untuned"]
BAD_STATES = get_args(BadState)
_SAME_PERIOD = 0.01
_STEPS_PER_OCTAVE = 53
"""Resolution of the period in the fingerprint."""
_SIZES = np.linspace(0.0, 6.0, 601)
"""True sizes in standard deviations, the lookup table of `denoised_size`."""


class DelayAxis(Axis):
    """m = mean |delay| of the drives over the period, noise subtracted, weighted by overlap.

    A delay matters to a controller relative to its period, early or late: the absolute delays of
    the drives are averaged, so that opposite signs do not cancel. The noise of each estimate adds
    to its size and is subtracted, so the floor is 0. The bad state is a delay of one whole period;
    that of the untuned simulator can be chosen instead, but differs between sets of drives.
    """

    parsers: ClassVar[Mapping[str, Parser]] = {
        "reach": reach,
        "bad": one_of(BAD_STATES),
        "period": lambda text: number(text, "seconds such as 0.05", 60.0),
    }

    def __init__(
        self, reach: float = 1.0, bad: BadState = "period", period: float | None = None
    ) -> None:
        """`reach` (s) bounds the search; `period` (s) replaces that of the commands."""
        self.max_delay = reach
        self.bad_state = bad
        self.period = period

    def missing(self, evidence: Evidence) -> str | None:
        known = self.period is not None or any(drive.commands for drive in evidence.drives)
        unknown = None if known else "no drive has commands.csv: the control period is not known"
        return no_drives(evidence) or unknown

    def measure(self, evidence: Evidence, settings: GapSettings) -> AxisResult:
        drives, period = evidence.drives, self._period(evidence.drives)
        delays = self._delays(evidence, [drive.sim for drive in drives])
        signed = mean_delay(delays, settings.level)

        def bounds(level: float) -> Interval:
            return mean_size(delays, level).scaled(1 / period)

        n = sum(int(each.overlap // time_delay.BLOCK) for each in delays)
        return AxisResult(
            value=bounds(settings.level).value,
            floor=0.0,
            n=n,
            bounds=bounds,
            fingerprint={
                "rate": time_delay.RATE,
                "smoothing": time_delay.SMOOTHING,
                "furthest": self.max_delay,
                "period": rounded_period(period),
            },
            details={
                **signed.as_columns("delay"),
                "delay_least": min(each.seconds for each in delays),
                "delay_most": max(each.seconds for each in delays),
                "period": period,
                "drives": [
                    {
                        "drive": drive.name,
                        **delay.interval(settings.level).as_columns("delay"),
                        "overlap": delay.overlap,
                        "correlation": delay.correlation,
                    }
                    for drive, delay in zip(drives, delays, strict=True)
                ],
            },
            notes=_notes(drives, delays),
        )

    def anchor(self, evidence: Evidence, settings: GapSettings) -> Anchor:
        if self.bad_state == "period":
            return Anchor(Interval(1.0, 1.0, 1.0), "one control period late")
        drives, period = evidence.drives, self._period(evidence.drives)
        delays = self._delays(evidence, [untuned_log(drive, "delay") for drive in drives])
        size = mean_size(delays, settings.level).scaled(1 / period)
        return Anchor(size, "the untuned simulator")

    def describe(self, details: Details) -> Iterator[str]:
        delay = Interval.from_columns(details, "delay").scaled(1000).with_bounds("{:.1f}".format)
        yield (
            f"delay {delay} ms, positive if reality lags; the control "
            f"period is {1000 * details['period']:g} ms"
        )

    def _delays(self, evidence: Evidence, sims: Sequence[Log]) -> list[time_delay.TimeDelay]:
        return [
            evidence.delays(drive.real, sim, time_delay.RATE, self.max_delay)
            for drive, sim in zip(evidence.drives, sims, strict=True)
        ]

    def _period(self, drives: Sequence[Drive]) -> float:
        """The control period that all commands share, s."""
        if self.period is not None:
            return self.period
        known = {drive.name: drive.commands.period for drive in drives if drive.commands}
        low, high = min(known, key=known.__getitem__), max(known, key=known.__getitem__)
        if known[high] > known[low] * (1 + _SAME_PERIOD):
            raise RequestError(
                f"delay: control period {known[low]:g} s in drive {low}, {known[high]:g} s in "
                f"{high}; measure them separately"
            )
        return float(np.median(list(known.values())))


def rounded_period(period: float) -> float:
    """The period rounded to one of 53 steps per octave from 0.05 s (1.3 %), and to 4 digits.

    Two measurements of one period round to the same step: all small products of 2, 3 and 5 lie near
    the middle of a step.
    """
    steps = round(_STEPS_PER_OCTAVE * float(np.log2(period / 0.05)))
    return float(f"{0.05 * 2 ** (steps / _STEPS_PER_OCTAVE):.4g}")


def denoised_size(size: Floats, deviation: float) -> Floats:
    """True absolute values whose expected absolute measurement under normal noise is `size`.

    Solves size = E|true + noise|, the mean of the folded normal distribution, for noise of standard
    deviation `deviation`; 0 where `size` is below that of noise alone. From twice the deviation on
    the correction is below 1 %.
    """
    if not deviation > 0:
        return np.asarray(size, dtype=np.float64)
    normal = stats.norm
    expected = _SIZES * (2 * normal.cdf(_SIZES) - 1) + 2 * normal.pdf(_SIZES)
    ratio = np.asarray(size) / deviation
    true = np.where(ratio < expected[-1], np.interp(ratio, expected, _SIZES), ratio)
    return np.asarray(true * deviation)


def mean_size(delays: Sequence[time_delay.TimeDelay], level: float = LEVEL) -> Interval:
    """Mean over the drives of |delay| corrected for noise, s, weighted by overlap.

    The interval of one drive is that of its delay, folded at 0 and corrected alike. That of several
    holds the noise of the single drives and the spread between them, whichever reaches further.
    Source of the former: Zou and Donner, "Construction of confidence limits about effect measures",
    Statistics in Medicine 27, 2008.
    """
    single = [_size(delay, level) for delay in delays]
    if len(delays) == 1:
        return single[0]
    values, lows, highs = (
        np.array([getattr(size, part) for size in single]) for part in ("value", "low", "high")
    )
    found = _pooled(delays, values, level).at_least(0.0)
    if found.reason:
        return found
    weights = np.array([delay.overlap for delay in delays])
    weights = weights / weights.sum()
    below, above = (
        float(np.sqrt(np.nansum(np.square(weights * (end - values))))) for end in (lows, highs)
    )
    low, high = max(0.0, found.value - below), found.value + above
    return replace(found, low=min(found.low, low), high=max(found.high, high))


def _size(delay: time_delay.TimeDelay, level: float) -> Interval:
    """|delay| of one drive corrected for noise, s."""
    found = delay.interval(level)
    value = float(denoised_size(np.array(abs(delay.seconds)), delay.error))
    ends = denoised_size(np.abs([found.low, found.high]), delay.error)
    low = 0.0 if found.low < 0 < found.high else float(ends.min())
    return Interval(low, value, float(ends.max()), level, found.reason, sample=found.sample)


def mean_delay(delays: Sequence[time_delay.TimeDelay], level: float = LEVEL) -> Interval:
    """Mean of the delays of the drives, s, weighted by overlap."""
    if len(delays) == 1:
        return delays[0].interval(level)
    return _pooled(delays, np.array([each.seconds for each in delays]), level)


def _pooled(delays: Sequence[time_delay.TimeDelay], values: Floats, level: float) -> Interval:
    """Mean of one value per drive, weighted by overlap."""
    overlap = np.array([delay.overlap for delay in delays])
    total = overlap.sum()
    left_out = (overlap @ values - overlap * values) / (total - overlap)
    return of_units(float(overlap @ values / total), left_out, unit="drives", level=level)


def _notes(drives: Sequence[Drive], delays: Sequence[time_delay.TimeDelay]) -> tuple[str, ...]:
    if len(delays) == 1:
        return ("one drive: the interval does not cover differences between drives",)
    order = np.argsort([delay.seconds for delay in delays])
    first, last = delays[order[0]], delays[order[-1]]
    if not first.interval().high < 0 < last.interval().low:
        return ()
    return (
        f"delays of both signs: {first.seconds:+.3g} s in drive {drives[order[0]].name}, "
        f"{last.seconds:+.3g} s in {drives[order[-1]].name}; do all logs use one clock?",
    )
