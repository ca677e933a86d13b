"""The dynamics axis: how far the simulated motion leaves the real one, delay taken out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from s2rstore.errors import InconclusiveError, RequestError
from s2rtools.gap.contract import Anchor, Axis, Evidence, Measured, Settings
from s2rtools.gap.dynamics import align, errors, noise, repeats
from s2rtools.gap.dynamics.bootstrap import Blocks, bounds
from s2rtools.gap.dynamics.windows import DEFAULT, Plan, Windows, windows
from s2rtools.logs.contract import Drive, Floats, Log

MIN_WINDOWS = 8
"""Per horizon, over all drives."""
MIRRORED = -0.5
"""Correlation of the yaw rates below which the logs turn opposite ways."""
_QUICK = 20
"""Replicates of delays whose interval nobody asks for."""


@dataclass(frozen=True, slots=True)
class _Compared:
    """One drive: its delay, the simulated log without it, and its windows."""

    drive: Drive
    sim: Log
    late: align.Delay
    made: Windows


@dataclass(frozen=True, slots=True)
class _Scales:
    """What errors are divided by, in m: per horizon (H,), and per resample (H, R)."""

    values: Floats
    draws: Floats


class Dynamics(Axis):
    """m = mean over the horizons of NRMSE(h), the root mean square end error over a scale(h)."""

    name: ClassVar[str] = "dynamics"
    unit: ClassVar[str] = "share of the scale"
    measure_is: ClassVar[str] = "windowed NRMSE of position after the delay is taken out"
    reason: ClassVar[str] = (
        "Windows restarted from real states keep one early slip from spoiling a whole drive, and "
        "the delay is an axis of its own. The floor is real against real where drives were "
        "repeated with the same commands, else what the measured noise of the poses alone would "
        "give in the same windows. The bad state is the simulator before identification, in the "
        "same windows."
    )

    def __init__(self, plan: Plan = DEFAULT, scale: str = "travel") -> None:
        """`scale` is one of `errors.SCALES`."""
        self.plan = plan
        self.scale = scale
        errors.scale_of(scale)

    def missing(self, evidence: Evidence) -> str | None:
        return None if evidence.drives else "no drives: give logs of real and simulated motion"

    def measure(self, evidence: Evidence, settings: Settings) -> Measured:
        compared = [self._compare(d, d.sim, settings) for d in evidence.drives]
        ends = [c.made.end**2 for c in compared]
        counts = self._counts(ends)
        blocks = self._blocks(ends, settings)
        scales = self._scales(evidence.drives, blocks)
        floors, kinds = self._floors(evidence.drives, compared, settings)
        mean, draws = blocks.means(ends)
        floor_mean, floor_draws = blocks.means(floors)
        value, replicates = _over_scale(mean, draws, scales, blocks)
        floor, floor_replicates = _over_scale(floor_mean, floor_draws, scales, blocks)
        kind = kinds[0] if len(set(kinds)) == 1 else "mixed"
        return Measured(
            axis=self.name,
            value=value,
            floor=floor,
            n=int(counts.sum()),
            replicates=replicates,
            floor_replicates=floor_replicates,
            fingerprint=self._fingerprint(kind),
            details={
                "scale": self.scale,
                "floor_from": kind,
                "horizons": self._per_horizon(compared, blocks, scales, counts, settings),
                "drives": [_told(c, k) for c, k in zip(compared, kinds, strict=True)],
            },
            notes=_notes(compared, kind),
        )

    def anchor(self, evidence: Evidence, settings: Settings) -> Anchor:
        found = []
        for drive in evidence.drives:
            untuned = untuned_of(drive, self.name)
            found.append(self._compare(drive, untuned, settings).made.end ** 2)
        blocks = self._blocks(found, settings)
        self._counts(found)
        scales = self._scales(evidence.drives, blocks)
        value, replicates = _over_scale(*blocks.means(found), scales, blocks)
        return Anchor(value, replicates, "the untuned simulator")

    def _compare(self, drive: Drive, sim: Log, settings: Settings) -> _Compared:
        quick = replace(settings, replicates=_QUICK)
        late = align.delay(drive.real, sim, quick, self.plan.rate)
        moved = align.without(sim, late.seconds)
        return _Compared(drive, moved, late, windows(drive.real, moved, self.plan))

    def _scales(self, drives: Sequence[Drive], blocks: Blocks) -> _Scales:
        """The mean over the drives by their length, and that of every resample of drives."""
        scale = errors.scale_of(self.scale)
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
                    f"dynamics: {count} windows of {horizon:g} s in the drives, {MIN_WINDOWS} are "
                    "needed; drive longer, or declare shorter horizons"
                )
        return np.asarray(counts)

    def _blocks(self, ends: Sequence[Floats], settings: Settings) -> Blocks:
        longest = int(np.ceil(self.plan.horizons[-1] / self.plan.stride))
        short = [end.shape[1] for end in ends]
        if min(short) < 2:
            raise InconclusiveError(
                f"dynamics: a drive is shorter than two windows of {self.plan.horizons[0]:g} s"
            )
        return Blocks(short, longest, settings)

    def _floors(
        self, drives: Sequence[Drive], compared: Sequence[_Compared], settings: Settings
    ) -> tuple[list[Floats], list[str]]:
        """Squares (H, K) per drive without a gap, and what they were found from."""
        floors, kinds = [], []
        for others, c in zip(repeats.partners(drives), compared, strict=True):
            if others:
                same = [drives[j] for j in others]
                floors.append(repeats.squares(c.drive, same, self.plan, settings))
                kinds.append("repeated real drives")
            else:
                floors.append(noise.squares(c.drive.real, c.sim, c.made, self.plan))
                kinds.append("noise of the poses")
        return floors, kinds

    def _fingerprint(self, floor: str) -> dict[str, str | int | float]:
        return {
            "horizons": ", ".join(f"{h:g}" for h in self.plan.horizons),
            "stride": self.plan.stride,
            "rate": self.plan.rate,
            "scale": self.scale,
            "floor_from": floor,
        }

    def _per_horizon(
        self,
        compared: Sequence[_Compared],
        blocks: Blocks,
        scales: _Scales,
        counts: Floats,
        settings: Settings,
    ) -> list[dict[str, Any]]:
        kinds: dict[str, Callable[[Windows], Floats]] = {
            "rmse": lambda made: made.end**2,
            "path_rmse": lambda made: made.path**2,
            "heading_rmse": lambda made: made.heading**2,
        }
        rows: list[dict[str, Any]] = [
            {"horizon": float(h), "windows": int(n), "scale": float(s)}
            for h, n, s in zip(self.plan.horizons, counts, scales.values, strict=True)
        ]
        for name, of in kinds.items():
            mean, draws = blocks.means([of(c.made) for c in compared])
            for i, row in enumerate(rows):
                root = np.sqrt(draws[i])
                row |= _bounded(name, float(np.sqrt(mean[i])), root, blocks, settings)
                if name == "rmse":
                    share = row["rmse"] / row["scale"]
                    row |= _bounded("nrmse", share, root / scales.draws[i], blocks, settings)
        return rows


def untuned_of(drive: Drive, axis: str) -> Log:
    """Raises RequestError where the drive has no untuned log."""
    if drive.untuned is None:
        raise RequestError(
            f"{axis}: drive {drive.name} has no untuned.*, the declared bad state; record one"
        )
    return drive.untuned


def _over_scale(
    mean: Floats, draws: Floats, scales: _Scales, blocks: Blocks
) -> tuple[float, Floats]:
    """m and its replicates (R,) from mean squares (H,) and (H, R) in m^2."""
    value = float((np.sqrt(mean) / scales.values).mean())
    return value, blocks.widened(value, (np.sqrt(draws) / scales.draws).mean(axis=0))


def _bounded(
    name: str, value: float, draws: Floats, blocks: Blocks, settings: Settings
) -> dict[str, float]:
    low, high = bounds(blocks.widened(value, draws), settings.level)
    return {name: value, f"{name}_low": low, f"{name}_high": high}


def _told(compared: _Compared, kind: str) -> dict[str, Any]:
    found = errors.ape(compared.drive.real, compared.sim)
    measured = noise.of(compared.drive.real)
    return {
        "drive": compared.drive.name,
        "delay": compared.late.seconds,
        "ape_rmse": errors.rmse(found.position),
        "heading_rmse": errors.rmse(found.heading),
        "noise_position": measured.position,
        "noise_heading": measured.heading,
        "floor_from": kind,
    }


def _notes(compared: Sequence[_Compared], kind: str) -> tuple[str, ...]:
    notes = [
        f"drive {c.drive.name}: the yaw rates are opposed; is one log in a mirrored frame?"
        for c in compared
        if c.late.correlation["yaw rate"] < MIRRORED
    ]
    if len(compared) == 1:
        notes.append("one drive: the interval says nothing of how drives differ")
    if kind != "repeated real drives":
        notes.append(
            "the floor is the noise of the poses; repeat real drives to know reality's own"
        )
    return tuple(notes)
