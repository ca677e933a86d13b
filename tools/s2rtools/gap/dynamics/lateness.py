"""The delay axis: how much later reality answers than the simulator, in control periods."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Literal

import numpy as np

from s2rstore.errors import RequestError
from s2rtools.gap.contract import Anchor, Axis, Evidence, Measured, Settings
from s2rtools.gap.dynamics import align
from s2rtools.gap.dynamics.axis import untuned_of
from s2rtools.gap.dynamics.bootstrap import MIN_DRIVES, bounds, drawn_drives, small_sample
from s2rtools.logs.contract import Drive, Floats, Log

BadState = Literal["untuned", "period"]
_SAME_PERIOD = 0.01


class Delay(Axis):
    """m = |delay| over the control period, the delay a mean over the drives by their overlap."""

    name: ClassVar[str] = "delay"
    unit: ClassVar[str] = "control periods"
    measure_is: ClassVar[str] = "absolute delay of reality behind the simulator"
    reason: ClassVar[str] = (
        "A controller feels a delay in its own periods. Without one, m would be the size of the "
        "estimate's noise: that is the floor. The bad state is the delay of the simulator before "
        "identification, or one whole period where that is declared."
    )

    def __init__(
        self,
        bad_state: BadState = "untuned",
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
            return "no drives: give logs of real and simulated motion"
        if self.period is None and all(drive.commands is None for drive in evidence.drives):
            return "no commands.csv beside the logs: the control period is not known"
        return None

    def measure(self, evidence: Evidence, settings: Settings) -> Measured:
        drives = evidence.drives
        period = self._period(drives)
        found = self._delays(drives, lambda drive: drive.sim, settings)
        signed, draws = _pooled(found, settings)
        noise = np.abs(draws - signed)
        low, high = bounds(draws, settings.level)
        floor = float(noise.mean()) / period
        n = sum(int(delay.overlap // align.BLOCK) for delay in found)
        return Measured(
            axis=self.name,
            value=abs(signed) / period,
            floor=floor,
            n=n,
            replicates=np.abs(draws) / period,
            floor_replicates=np.full(draws.size, floor),
            fingerprint={
                "rate": self.rate,
                "smoothing": align.SMOOTHING,
                "furthest": self.furthest,
                "period": round(period, 6),
            },
            details={
                "delay": signed,
                "delay_low": low,
                "delay_high": high,
                "period": period,
                "drives": [_told(d, late) for d, late in zip(drives, found, strict=True)],
            },
        )

    def anchor(self, evidence: Evidence, settings: Settings) -> Anchor:
        if self.bad_state == "period":
            return Anchor(1.0, np.ones(settings.replicates), "one control period late")
        drives = evidence.drives
        period = self._period(drives)
        found = self._delays(drives, lambda drive: untuned_of(drive, self.name), settings)
        signed, draws = _pooled(found, settings)
        return Anchor(abs(signed) / period, np.abs(draws) / period, "the untuned simulator")

    def _delays(
        self, drives: Sequence[Drive], simulated: Callable[[Drive], Log], settings: Settings
    ) -> list[align.Delay]:
        return [
            align.delay(drive.real, simulated(drive), settings, self.rate, self.furthest)
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


def _told(drive: Drive, late: align.Delay) -> dict[str, Any]:
    return {
        "drive": drive.name,
        "delay": late.seconds,
        "delay_low": late.low,
        "delay_high": late.high,
        "overlap": late.overlap,
        "correlation": late.correlation,
    }


def _pooled(found: Sequence[align.Delay], settings: Settings) -> tuple[float, Floats]:
    """Mean delay over the drives, s, and its replicates (R,), resampled as `Blocks` are."""
    if len(found) == 1:
        return found[0].seconds, found[0].replicates
    count = len(found)
    overlap = np.array([delay.overlap for delay in found])
    each = np.array([delay.seconds for delay in found])
    signed = float(np.average(each, weights=overlap))
    rng = np.random.default_rng(settings.seed)
    weights = drawn_drives(count, rng, settings.replicates) * overlap
    if count >= MIN_DRIVES:
        means = weights @ each / weights.sum(axis=1)
        return signed, np.asarray(signed + (means - signed) * small_sample(count, settings.level))
    # Drives are independent: each has its own order of replicates.
    table = np.stack([rng.permutation(delay.replicates) for delay in found], axis=1)
    return signed, np.asarray((weights * table).sum(axis=1) / weights.sum(axis=1))
