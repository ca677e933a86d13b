"""The delay axis: how much later reality answers than the simulator, in control periods."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Literal, get_args

import numpy as np
from scipy import stats

from s2rstore.errors import RequestError
from s2rstore.metrics.bootstrap import percentile_bounds
from s2rtools.gap.axis_result import Anchor, Axis, AxisResult, Evidence, GapSettings
from s2rtools.gap.bootstrap_correction import widened
from s2rtools.gap.delay import time_delay
from s2rtools.gap.dynamics.log_quality import untuned_of
from s2rtools.gap.dynamics.window_bootstrap import drawn_drives
from s2rtools.motion_logs.motion_log import Drive, Floats, Log

BadState = Literal["period", "untuned"]
BAD_STATES = get_args(BadState)
_SAME_PERIOD = 0.01
_STEPS = 53
"""Per octave, of the periods that are told apart."""
_SIZES = np.linspace(0.0, 6.0, 601)
"""True sizes in deviations, for what `beyond_noise` looks up."""


class DelayAxis(Axis):
    """m = mean of the drives' |delay| beyond noise, by overlap, over the control period."""

    name: ClassVar[str] = "delay"
    unit: ClassVar[str] = "control periods"
    measure_is: ClassVar[str] = "absolute delay of reality behind the simulator"
    floor_is: ClassVar[str] = "0: what noise adds to a delay's size is taken out of m"
    reason: ClassVar[str] = (
        "A controller feels a delay in its own periods, early or late: drives are judged by the "
        "size of their own delays, so that opposite ones do not cancel. What the estimate's noise "
        "adds to a size is taken off each drive's, so the floor is 0. The bad state is one whole "
        "period late: the untuned simulator's own delay, which may be asked for instead, is "
        "another for every set of drives, and smaller where reality is later."
    )

    def __init__(
        self,
        bad_state: BadState = "period",
        period: float | None = None,
        rate: float = 50.0,
        furthest: float = 1.0,
    ) -> None:
        """`period` (s) stands in for that of the commands; `furthest` (s) bounds the search."""
        self.bad_state = bad_state
        self.period = period
        self.rate = rate
        self.furthest = furthest

    def missing(self, evidence: Evidence) -> str | None:
        if not evidence.drives:
            return "no drives: name a folder of real and simulated logs (--drives)"
        if self.period is None and all(drive.commands is None for drive in evidence.drives):
            return "no commands.csv beside the logs: the control period is not known"
        return None

    def measure(self, evidence: Evidence, settings: GapSettings) -> AxisResult:
        drives = evidence.drives
        period = self._period(drives)
        found = self._delays(drives, lambda drive: drive.sim, settings)
        value, replicates = sizes(found, settings)
        signed, draws = _pooled(found, np.array([late.seconds for late in found]), settings)
        low, high = percentile_bounds(draws, settings.level)
        n = sum(int(delay.overlap // time_delay.BLOCK) for delay in found)
        return AxisResult(
            axis=self.name,
            value=value / period,
            floor=0.0,
            n=n,
            replicates=replicates / period,
            floor_replicates=np.zeros(replicates.size),
            fingerprint={
                "rate": self.rate,
                "smoothing": time_delay.SMOOTHING,
                "furthest": self.furthest,
                "period": told_apart(period),
            },
            details={
                "delay": signed,
                "delay_low": low,
                "delay_high": high,
                "delay_least": min(late.seconds for late in found),
                "delay_most": max(late.seconds for late in found),
                "period": period,
                "drives": [_told(d, late) for d, late in zip(drives, found, strict=True)],
            },
            notes=_notes(drives, found),
        )

    def anchor(self, evidence: Evidence, settings: GapSettings) -> Anchor:
        if self.bad_state == "period":
            return Anchor(1.0, np.ones(settings.replicates), "one control period late")
        drives = evidence.drives
        period = self._period(drives)
        found = self._delays(drives, lambda drive: untuned_of(drive, self.name), settings)
        value, replicates = sizes(found, settings)
        return Anchor(value / period, replicates / period, "the untuned simulator")

    def _delays(
        self, drives: Sequence[Drive], simulated: Callable[[Drive], Log], settings: GapSettings
    ) -> list[time_delay.TimeDelay]:
        return [
            time_delay.delay(drive.real, simulated(drive), settings, self.rate, self.furthest)
            for drive in drives
        ]

    def _period(self, drives: Sequence[Drive]) -> float:
        """The one period, s, that all commands agree on."""
        if self.period is not None:
            if not self.period > 0:
                raise RequestError(f"control period {self.period:g} s: must be positive")
            return self.period
        known = {drive.name: drive.commands.period for drive in drives if drive.commands}
        if not known:
            raise RequestError("delay: no drive has commands.csv, so no control period is known")
        low, high = min(known, key=known.__getitem__), max(known, key=known.__getitem__)
        if known[high] > known[low] * (1 + _SAME_PERIOD):
            raise RequestError(
                f"delay: control period {known[low]:g} s in drive {low}, {known[high]:g} s in "
                f"{high}; judge them apart"
            )
        return float(np.median(list(known.values())))


def _told(drive: Drive, late: time_delay.TimeDelay) -> dict[str, Any]:
    return {
        "drive": drive.name,
        "delay": late.seconds,
        "delay_low": late.low,
        "delay_high": late.high,
        "overlap": late.overlap,
        "correlation": late.correlation,
    }


def told_apart(period: float) -> float:
    """The nearest of 53 steps per octave from 0.05 s (1.3 %), to 4 digits.

    Periods measured on two nights share a step: all small products of 2, 3 and 5 lie near the
    middle of one.
    """
    steps = round(_STEPS * float(np.log2(period / 0.05)))
    return float(f"{0.05 * 2 ** (steps / _STEPS):.4g}")


def beyond_noise(size: Floats, deviation: float) -> Floats:
    """The true sizes that normal noise would show as `size`, on average; 0 where it is less.

    Solves size = E|true + noise|, the mean of the folded normal: from twice the deviation on
    nothing is changed by more than 1 %.
    """
    if not deviation > 0:
        return np.asarray(size, dtype=np.float64)
    normal = stats.norm
    shown = _SIZES * (2 * normal.cdf(_SIZES) - 1) + 2 * normal.pdf(_SIZES)
    seen = np.asarray(size) / deviation
    return np.asarray(np.where(seen < shown[-1], np.interp(seen, shown, _SIZES), seen) * deviation)


def sizes(found: Sequence[time_delay.TimeDelay], settings: GapSettings) -> tuple[float, Floats]:
    """Mean over the drives of |delay| beyond its noise, s, and its replicates (R,).

    Of one drive: the folded interval. At a true delay on the threshold 2.5 % of 20 000 simulated
    95 % intervals end below it where the noise is 0.1 and 0.3 of the delay, none where it is 0.6.
    """
    noise = [float(late.replicates.std()) for late in found]
    if len(found) == 1:
        late = found[0]
        value = beyond_noise(np.array(abs(late.seconds)), noise[0])
        return float(value), beyond_noise(np.abs(late.replicates), noise[0])
    each = [beyond_noise(np.array(abs(d.seconds)), s) for d, s in zip(found, noise, strict=True)]
    mean, replicates = _pooled(found, np.array(each), settings)
    return mean, np.maximum(replicates, 0.0)


def _pooled(
    found: Sequence[time_delay.TimeDelay], each: Floats, settings: GapSettings
) -> tuple[float, Floats]:
    """Mean by overlap of a figure of each drive, and its replicates (R,), drives resampled."""
    if len(found) == 1:
        return found[0].seconds, found[0].replicates
    overlap = np.array([delay.overlap for delay in found])
    mean = float(np.average(each, weights=overlap))
    weights = drawn_drives(len(found), settings) * overlap
    means = weights @ each / weights.sum(axis=1)
    return mean, widened(means, mean, len(found), settings.level)


def _notes(drives: Sequence[Drive], found: Sequence[time_delay.TimeDelay]) -> tuple[str, ...]:
    if len(found) == 1:
        return ("one drive: the interval says nothing of how drives differ",)
    early, late = (pick(range(len(found)), key=lambda i: found[i].seconds) for pick in (min, max))
    if found[early].high < 0 < found[late].low:
        return (
            f"delays of both signs: {found[early].seconds:+.3g} s in drive {drives[early].name}, "
            f"{found[late].seconds:+.3g} s in {drives[late].name}; are the clocks the same?",
        )
    return ()
