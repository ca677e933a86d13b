"""The dynamics axis: how far the simulated motion leaves the real one, delay taken out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from s2rstore.errors import InconclusiveError
from s2rstore.metrics.bootstrap import percentile_bounds
from s2rtools.gap.axis_result import Anchor, Axis, AxisResult, Evidence, GapSettings
from s2rtools.gap.delay import time_delay
from s2rtools.gap.dynamics import log_quality, pose_errors, repeatability
from s2rtools.gap.dynamics import noise_floor as noise
from s2rtools.gap.dynamics.ape_rpe import WHOLE, Whole
from s2rtools.gap.dynamics.noise_floor import Noise
from s2rtools.gap.dynamics.window_bootstrap import Resamples
from s2rtools.gap.dynamics.windows import DEFAULT, DriveWindows, WindowPlan, windows
from s2rtools.motion_logs.motion_log import Drive, Floats, Log

MIN_WINDOWS = 8
"""Per horizon, over all drives."""
MIRRORED = -0.5
"""Correlation of the yaw rates below which the logs turn opposite ways."""
_NOISE = "noise of the poses"
_QUICK = 20
"""Replicates of delays whose interval nobody asks for."""


@dataclass(frozen=True, slots=True)
class _Compared:
    """One drive: its delay, the simulated log without it, and its windows."""

    drive: Drive
    sim: Log
    late: time_delay.TimeDelay
    made: DriveWindows


@dataclass(frozen=True, slots=True)
class _Scales:
    """What errors are divided by, in m: per horizon (H,), and per resample (H, R)."""

    values: Floats
    draws: Floats


@dataclass(frozen=True, slots=True)
class _Found:
    """All drives: windows per horizon `counts` (H,), and mean squares in m^2.

    `ends` are those of the windows, `floors` those that they would have without a gap: per horizon
    (H,), and per resample (H, R).
    """

    compared: list[_Compared]
    kinds: list[str]
    counts: Floats
    blocks: Resamples
    scales: _Scales
    ends: tuple[Floats, Floats]
    floors: tuple[Floats, Floats]

    def beyond_floor(self) -> tuple[float, Floats]:
        """m and its replicates (R,): the root of what squares have more than without a gap."""
        values, draws = (e - f for e, f in zip(self.ends, self.floors, strict=True))
        shares = values / self.scales.values**2
        spread = self.blocks.widened(shares, draws / self.scales.draws**2)
        return float(_root(shares).mean()), _root(spread).mean(axis=0)


class Dynamics(Axis):
    """m = mean over the horizons of root(mean square end error - that without a gap) / scale(h).

    Squares are subtracted because noise adds to squares: m stays the same where poses are noisier.
    """

    name: ClassVar[str] = "dynamics"
    unit: ClassVar[str] = "share of the scale"
    measure_is: ClassVar[str] = (
        "windowed NRMSE of position beyond reality's own, the delay taken out"
    )
    floor_is: ClassVar[str] = "0: what reality differs by from itself is taken out of m"
    reason: ClassVar[str] = (
        "Windows restarted from real states keep one early slip from spoiling a whole drive, and "
        "the delay is an axis of its own. What is seen without a gap is taken off in squares, so "
        "the floor is 0: half of real against real where drives were repeated with the same "
        "commands, else what the noise of the real poses would give in the same windows. The bad "
        "state is the simulator before identification, in the same windows."
    )

    def __init__(
        self,
        plan: WindowPlan = DEFAULT,
        scale: str = "travel",
        whole: Whole = WHOLE,
        noise: Noise | None = None,
        furthest: float = 1.0,
    ) -> None:
        """`scale` is one of `errors.SCALES`; `furthest` (s) bounds the search for delays.

        `noise` of the real poses None: measured. `whole` changes nothing of m.
        """
        self.plan = plan
        self.scale = scale
        self.whole = whole
        self.noise = noise
        self.furthest = furthest
        pose_errors.scale_of(scale)

    def missing(self, evidence: Evidence) -> str | None:
        if evidence.drives:
            return None
        return "no drives: name a folder of real and simulated logs (--drives)"

    def measure(self, evidence: Evidence, settings: GapSettings) -> AxisResult:
        found = self._found(evidence.drives, [drive.sim for drive in evidence.drives], settings)
        value, replicates = found.beyond_floor()
        kind = found.kinds[0] if len(set(found.kinds)) == 1 else "mixed"
        seen, floor = (
            float((np.sqrt(m) / found.scales.values).mean())
            for m in (found.ends[0], found.floors[0])
        )
        return AxisResult(
            axis=self.name,
            value=value,
            floor=0.0,
            n=int(found.counts.sum()),
            replicates=replicates,
            floor_replicates=np.zeros(replicates.size),
            fingerprint=self._fingerprint(kind),
            details={
                "scale": self.scale,
                "nrmse": seen,
                "floor_nrmse": floor,
                "floor_from": kind,
                "horizons": self._per_horizon(found, settings),
                "alignment": str(self.whole.alignment),
                "rpe_step": str(self.whole.step),
                "reach": self.furthest,
                "drives": [
                    self._told(c, k) for c, k in zip(found.compared, found.kinds, strict=True)
                ],
            },
            notes=_notes(found.compared, kind),
        )

    def anchor(self, evidence: Evidence, settings: GapSettings) -> Anchor:
        untuned = [log_quality.untuned_of(drive, self.name) for drive in evidence.drives]
        found = self._found(evidence.drives, untuned, settings)
        return Anchor(*found.beyond_floor(), "the untuned simulator")

    def _found(self, drives: Sequence[Drive], sims: Sequence[Log], settings: GapSettings) -> _Found:
        compared = [self._compare(d, s, settings) for d, s in zip(drives, sims, strict=True)]
        ends = [c.made.end**2 for c in compared]
        counts = self._counts(ends)
        blocks = self._blocks(ends, settings)
        scales = self._scales(drives, blocks)
        floors, kinds = self._floors(drives, compared, settings)
        return _Found(
            compared, kinds, counts, blocks, scales, blocks.means(ends), blocks.means(floors)
        )

    def _compare(self, drive: Drive, sim: Log, settings: GapSettings) -> _Compared:
        for log in (drive.real, sim):
            log_quality.demand_fine(log, self.plan.horizons[0])
        log_quality.demand_motion(drive.real, self.plan.horizons[0], self._noise(drive.real))
        quick = replace(settings, replicates=_QUICK)
        late = time_delay.delay(drive.real, sim, quick, self.plan.rate, self.furthest)
        moved = time_delay.without(sim, late.seconds)
        return _Compared(drive, moved, late, windows(drive.real, moved, self.plan))

    def _noise(self, real: Log) -> Noise:
        return self.noise or noise.of(real)

    def _scales(self, drives: Sequence[Drive], blocks: Resamples) -> _Scales:
        """The mean over the drives by their length, and that of every resample of drives."""
        scale = pose_errors.scale_of(self.scale)
        seconds = np.array([drive.real.time[-1] - drive.real.time[0] for drive in drives])
        table = np.array([[scale(d.real, h) for h in self.plan.horizons] for d in drives])
        weights = blocks.drawn * seconds
        draws = (weights @ table).T / weights.sum(axis=1)
        return _Scales(seconds @ table / seconds.sum(), draws)

    def _counts(self, ends: Sequence[Floats]) -> Floats:
        """Windows per horizon (H,); raises InconclusiveError where they are too few."""
        counts = np.sum([np.isfinite(end).sum(axis=1) for end in ends], axis=0)
        for horizon, count in zip(self.plan.horizons, counts, strict=True):
            if count < MIN_WINDOWS:
                raise InconclusiveError(
                    f"{count} windows of {horizon:g} s in the drives, {MIN_WINDOWS} are "
                    "needed; drive longer, or ask for shorter ones (--dynamics horizons=...)"
                )
        return np.asarray(counts)

    def _blocks(self, ends: Sequence[Floats], settings: GapSettings) -> Resamples:
        longest = int(np.ceil(self.plan.longest / self.plan.stride))
        short = [end.shape[1] for end in ends]
        if min(short) < 2:
            raise InconclusiveError(
                f"a drive is shorter than two windows of {self.plan.horizons[0]:g} s"
            )
        return Resamples(short, longest, settings)

    def _floors(
        self, drives: Sequence[Drive], compared: Sequence[_Compared], settings: GapSettings
    ) -> tuple[list[Floats], list[str]]:
        """Squares (H, K) per drive without a gap, and what they were found from."""
        floors, kinds = [], []
        for others, c in zip(repeatability.partners(drives), compared, strict=True):
            if others:
                same = [drives[j] for j in others]
                floors.append(
                    repeatability.squares(c.drive, same, self.plan, settings, self.furthest)
                )
                kinds.append("repeated real drives")
            else:
                real = c.drive.real
                floors.append(noise.squares(real, c.made, self._noise(real)))
                kinds.append(_NOISE if self.noise is None else f"declared noise {self.noise}")
        return floors, kinds

    def _fingerprint(self, floor: str) -> dict[str, str | int | float]:
        return {
            "horizons": ", ".join(f"{h:g}" for h in self.plan.horizons),
            "stride": self.plan.stride,
            "rate": self.plan.rate,
            "scatter": self.plan.scatter,
            "scale": self.scale,
            "furthest": self.furthest,
            "floor_from": floor,
        }

    def _per_horizon(self, found: _Found, settings: GapSettings) -> list[dict[str, Any]]:
        kinds: dict[str, Callable[[DriveWindows], Floats]] = {
            "rmse": lambda made: made.end**2,
            "path_rmse": lambda made: made.path**2,
            "heading_rmse": lambda made: made.heading**2,
        }
        blocks, scales = found.blocks, found.scales
        floors = np.sqrt(found.floors[0])
        rows: list[dict[str, Any]] = [
            {"horizon": float(h), "windows": int(n), "scale": float(s), "floor_rmse": float(f)}
            for h, n, s, f in zip(
                self.plan.horizons, found.counts, scales.values, floors, strict=True
            )
        ]
        for name, of in kinds.items():
            mean, draws = blocks.means([of(c.made) for c in found.compared])
            for i, row in enumerate(rows):
                root = np.sqrt(draws[i])
                row |= _bounded(name, float(np.sqrt(mean[i])), root, blocks, settings)
                if name == "rmse":
                    share = row["rmse"] / row["scale"]
                    row |= _bounded("nrmse", share, root / scales.draws[i], blocks, settings)
        return rows

    def _told(self, compared: _Compared, kind: str) -> dict[str, Any]:
        measured = self._noise(compared.drive.real)
        return {
            "drive": compared.drive.name,
            "delay": compared.late.seconds,
            **self.whole.figures(compared.drive, compared.sim),
            "noise_position": measured.position,
            "noise_heading": measured.heading,
            "floor_from": kind,
        }


def _root(squares: Floats) -> Floats:
    """With the sign of the squares: where there is no gap it falls to either side of 0."""
    return np.asarray(np.sign(squares) * np.sqrt(np.abs(squares)))


def _bounded(
    name: str, value: float, draws: Floats, blocks: Resamples, settings: GapSettings
) -> dict[str, float]:
    spread = np.maximum(blocks.widened(np.array(value), draws), 0.0)
    low, high = percentile_bounds(spread, settings.level)
    return {name: value, f"{name}_low": low, f"{name}_high": high}


def _notes(compared: Sequence[_Compared], kind: str) -> tuple[str, ...]:
    notes = [
        f"drive {c.drive.name}: the yaw rates are opposed; is one log in a mirrored frame?"
        for c in compared
        if c.late.correlation["yaw rate"] < MIRRORED
    ]
    notes.extend(
        f"drive {c.drive.name}: odometry, {c.drive.odometry} onto the ground truth before all else"
        for c in compared
        if c.drive.odometry is not None
    )
    notes.extend(doubt for c in compared for doubt in log_quality.doubts(c.drive))
    if len(compared) == 1:
        notes.append("one drive: the interval says nothing of how drives differ")
    if kind in (_NOISE, "mixed"):
        notes.append(
            "only noise of the real poses is taken off; repeat real drives to know reality's own"
        )
    return tuple(notes)
