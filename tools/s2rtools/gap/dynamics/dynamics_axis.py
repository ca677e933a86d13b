"""The dynamics axis: error of the simulated motion after its time delay is removed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from s2rstore.errors import InconclusiveError
from s2rstore.intervals import Interval
from s2rtools.common.command_line import output
from s2rtools.gap.axis import (
    Anchor,
    Axis,
    AxisResult,
    Details,
    Evidence,
    GapSettings,
    Parser,
    no_drives,
    one_of,
    reach,
    with_interval,
)
from s2rtools.gap.delay import time_delay
from s2rtools.gap.delay.time_delay import DelayEstimates
from s2rtools.gap.dynamics import ape_rpe, log_quality, noise_floor
from s2rtools.gap.dynamics.ape_rpe import DEFAULT_STEP, NO_ALIGNMENT, LogAlignment, RpeStep
from s2rtools.gap.dynamics.noise_floor import Noise
from s2rtools.gap.dynamics.windows import DEFAULT, DriveWindows, WindowPlan, WindowUnits, windows
from s2rtools.motion_logs.motion_log import Drive, Floats, Log

MIN_WINDOWS = 8
"""Fewest windows per horizon, over all drives."""
MIRRORED = -0.5
"""Correlation of the yaw rates below which the logs turn in opposite directions."""
_NOISE = "noise of the poses"
_SCALE_TEXTS = {
    "travel": "the mean distance driven within the horizon",
    "extent": "the diagonal of the bounding box of the path",
    "deviation": "the standard deviation of the positions",
}


@dataclass(frozen=True, slots=True)
class _DriveResult:
    """One drive: the simulated log without its time delay, the delay, and the windows."""

    drive: Drive
    sim: Log
    delay: time_delay.TimeDelay
    windows: DriveWindows


@dataclass(frozen=True, slots=True)
class _DriveSet:
    """All drives: window `counts` (H,), and figures per horizon (H,) and without each unit (H, G).

    `scales` are lengths that normalise errors, m; `ends` are mean squared errors at the windows'
    ends, m^2, and `floors` their expectation without a gap.
    """

    drives: list[_DriveResult]
    floor_sources: list[str]
    counts: Floats
    units: WindowUnits
    scales: tuple[Floats, Floats]
    ends: tuple[Floats, Floats]
    floors: tuple[Floats, Floats]

    def excess(self, level: float) -> Interval:
        """m: the signed root of the mean squared error minus its floor, mean over the horizons."""
        values, left_out = (
            _signed_root((ends - floors) / scales**2).mean(axis=0)
            for ends, floors, scales in zip(self.ends, self.floors, self.scales, strict=True)
        )
        return self.units.interval(float(values), left_out, level)


class DynamicsAxis(Axis):
    """m = mean over the horizons of root(mean squared end error - its noise floor) / scale(h).

    Every window restarts from a real pose, so that one early error does not dominate a whole drive;
    the time delay is another axis. The noise floor is subtracted in squares, because independent
    noise adds to squares: m does not grow with the noise of the poses, and is 0 without a gap. The
    floor is half the squared difference of real drives with the same commands, or else the error
    that the noise of the real poses causes in the same windows. The bad state is the simulator
    before identification, in the same windows.
    """

    parsers: ClassVar[Mapping[str, Parser]] = {
        "horizons": WindowPlan.parse,
        "nrmse": one_of(ape_rpe.SCALES),
        "align": LogAlignment.parse,
        "rpe": RpeStep.parse,
        "noise": Noise.parse,
        "reach": reach,
    }

    def __init__(
        self,
        horizons: WindowPlan = DEFAULT,
        nrmse: str = "travel",
        align: LogAlignment = NO_ALIGNMENT,
        rpe: RpeStep = DEFAULT_STEP,
        noise: Noise | None = None,
        reach: float = 1.0,
    ) -> None:
        """`nrmse` is one of `ape_rpe.SCALES`; `reach` (s) bounds the search for delays.

        `noise` None: the noise of the real poses is estimated. `align` and `rpe` do not affect m.
        """
        self.plan = horizons
        self.scale = nrmse
        self.alignment, self.rpe_step = align, rpe
        self.noise = noise
        self.max_delay = reach

    def missing(self, evidence: Evidence) -> str | None:
        return no_drives(evidence)

    def measure(self, evidence: Evidence, settings: GapSettings) -> AxisResult:
        measured = self._compare_all(evidence, [drive.sim for drive in evidence.drives])
        sources = measured.floor_sources
        source = sources[0] if len(set(sources)) == 1 else "mixed"
        nrmse, floor = (
            float((np.sqrt(squares[0]) / measured.scales[0]).mean())
            for squares in (measured.ends, measured.floors)
        )
        return AxisResult(
            value=measured.excess(settings.level).value,
            floor=0.0,
            n=int(measured.counts.sum()),
            bounds=measured.excess,
            fingerprint={
                "horizons": ", ".join(f"{h:g}" for h in self.plan.horizons),
                "stride": self.plan.stride,
                "rate": self.plan.rate,
                "scatter": self.plan.scatter,
                "scale": self.scale,
                "furthest": self.max_delay,
                "floor_from": source,
            },
            details={
                "scale": self.scale,
                "nrmse": nrmse,
                "floor_nrmse": floor,
                "floor_from": source,
                "horizons": _horizon_rows(self.plan, measured, settings.level),
                "alignment": str(self.alignment),
                "rpe_step": str(self.rpe_step),
                "reach": self.max_delay,
                "drives": [
                    self._drive_row(each, kind)
                    for each, kind in zip(measured.drives, sources, strict=True)
                ],
            },
            notes=_notes(measured.drives, source),
        )

    def anchor(self, evidence: Evidence, settings: GapSettings) -> Anchor:
        untuned = [log_quality.untuned_log(drive, "dynamics") for drive in evidence.drives]
        measured = self._compare_all(evidence, untuned)
        return Anchor(measured.excess(settings.level), "the untuned simulator")

    def describe(self, details: Details) -> Iterator[str]:
        rows = [
            (f"{row['horizon']:g} s", row["windows"], with_interval(row, "rmse"),
             with_interval(row, "nrmse"),
             Interval.from_columns(row, "heading_rmse").scaled(180 / math.pi).with_bounds())
            for row in details["horizons"]
        ]  # fmt: skip
        yield f"NRMSE is RMSE over {_SCALE_TEXTS[details['scale']]}"
        yield output.table(("horizon", "windows", "RMSE m", "NRMSE", "heading degrees"), rows)
        yield (
            f"whole drives after removal of the delay (searched within {details['reach']:g} s); "
            f"alignment before APE and RPE: {details['alignment']}; RPE over {details['rpe_step']}"
        )
        drives = [
            (row["drive"], 1000 * row["delay"], row["ape_rmse"], row["ape_rmse_recorded"],
             _degrees(row["heading_rmse"]), row["rpe_rmse"], _degrees(row["rpe_heading_rmse"]))
            for row in details["drives"]
        ]  # fmt: skip
        names = ("drive", "delay ms", "APE m", "APE as recorded m", "heading degrees", "RPE m",
                 "RPE heading degrees")  # fmt: skip
        yield output.table(names, drives)

    def _compare_all(self, evidence: Evidence, sims: Sequence[Log]) -> _DriveSet:
        drives = evidence.drives
        compared = [
            self._compare(drive, sim, evidence.delays)
            for drive, sim in zip(drives, sims, strict=True)
        ]
        ends = [each.windows.end**2 for each in compared]
        counts = np.sum([np.isfinite(end).sum(axis=1) for end in ends], axis=0)
        for horizon, count in zip(self.plan.horizons, counts, strict=True):
            if count < MIN_WINDOWS:
                raise InconclusiveError(
                    f"{count} windows of {horizon:g} s in the drives, {MIN_WINDOWS} are "
                    "needed; record longer drives, or use shorter --dynamics horizons=..."
                )
        windows_of = [end.shape[1] for end in ends]
        if min(windows_of) < 2:
            raise InconclusiveError(
                f"a drive is shorter than two windows of {self.plan.horizons[0]:g} s"
            )
        longest = int(np.ceil(self.plan.longest / self.plan.stride))
        units = WindowUnits(windows_of, longest)
        floors, sources = self._floors(drives, compared)
        return _DriveSet(
            compared, sources, counts, units, self._scales(drives, units), units.means(ends),
            units.means(floors),
        )  # fmt: skip

    def _compare(self, drive: Drive, sim: Log, delays: DelayEstimates) -> _DriveResult:
        for log in (drive.real, sim):
            log_quality.require_sampling(log, self.plan.horizons[0])
        log_quality.require_motion(drive.real, self.plan.horizons[0], self._noise(drive.real))
        delay = delays(drive.real, sim, self.plan.rate, self.max_delay)
        aligned = time_delay.shifted(sim, delay.seconds)
        return _DriveResult(drive, aligned, delay, windows(drive.real, aligned, self.plan))

    def _noise(self, real: Log) -> Noise:
        return self.noise or noise_floor.estimate_noise(real)

    def _scales(self, drives: Sequence[Drive], units: WindowUnits) -> tuple[Floats, Floats]:
        """Means over the drives weighted by duration: (H,), and without each unit (H, G)."""
        scale = ape_rpe.SCALES[self.scale]
        seconds = np.array([drive.real.time[-1] - drive.real.time[0] for drive in drives])
        table = np.array([[scale(d.real, h) for h in self.plan.horizons] for d in drives])
        return units.drive_means(table, seconds)

    def _floors(
        self, drives: Sequence[Drive], compared: Sequence[_DriveResult]
    ) -> tuple[list[Floats], list[str]]:
        """Expected squares (H, K) per drive without a gap, and the source of each."""
        floors, sources = [], []
        for others, each in zip(noise_floor.repetitions(drives), compared, strict=True):
            if others:
                repeated = [drives[j] for j in others]
                floors.append(
                    noise_floor.repeatability_squares(
                        each.drive, repeated, self.plan, self.max_delay
                    )
                )
                sources.append("repeated real drives")
            else:
                real = each.drive.real
                floors.append(noise_floor.noise_squares(real, each.windows, self._noise(real)))
                sources.append(_NOISE if self.noise is None else f"declared noise {self.noise}")
        return floors, sources

    def _drive_row(self, compared: _DriveResult, floor_source: str) -> dict[str, Any]:
        noise = self._noise(compared.drive.real)
        return {
            "drive": compared.drive.name,
            "delay": compared.delay.seconds,
            **ape_rpe.drive_errors(compared.drive, compared.sim, self.alignment, self.rpe_step),
            "noise_position": noise.position,
            "noise_heading": noise.heading,
            "floor_from": floor_source,
        }


def _degrees(radians: float | None) -> float | None:
    return None if radians is None else math.degrees(radians)


def _signed_root(squares: Floats) -> Floats:
    """Root of the absolute value, with the sign of `squares`; varies about 0 without a gap."""
    return np.asarray(np.sign(squares) * np.sqrt(np.abs(squares)))


def _horizon_rows(plan: WindowPlan, measured: _DriveSet, level: float) -> list[dict[str, Any]]:
    kinds: dict[str, Callable[[DriveWindows], Floats]] = {
        "rmse": lambda each: each.end**2,
        "path_rmse": lambda each: each.path**2,
        "heading_rmse": lambda each: each.heading**2,
    }
    units, scales = measured.units, measured.scales
    floors = np.sqrt(measured.floors[0])
    rows: list[dict[str, Any]] = [
        {"horizon": float(h), "windows": int(n), "scale": float(s), "floor_rmse": float(f)}
        for h, n, s, f in zip(plan.horizons, measured.counts, scales[0], floors, strict=True)
    ]
    for name, squares in kinds.items():
        roots = [np.sqrt(m) for m in units.means([squares(d.windows) for d in measured.drives])]
        figures = {name: roots}
        if name == "rmse":
            figures["nrmse"] = [root / scale for root, scale in zip(roots, scales, strict=True)]
        for figure, (values, left_out) in figures.items():
            for row, value, without in zip(rows, values.tolist(), left_out, strict=True):
                found = units.interval(value, without, level).at_least(0.0)
                row |= found.as_columns(figure)
    return rows


def _notes(drives: Sequence[_DriveResult], floor_source: str) -> tuple[str, ...]:
    notes = [
        f"drive {each.drive.name}: the yaw rates have opposite signs; is one log in a mirrored "
        "frame?"
        for each in drives
        if each.delay.correlation["yaw rate"] < MIRRORED
    ]
    notes.extend(
        f"drive {each.drive.name}: the odometry was first aligned with the ground truth "
        f"({each.drive.odometry})"
        for each in drives
        if each.drive.odometry is not None
    )
    notes.extend(warning for each in drives for warning in log_quality.log_warnings(each.drive))
    if len(drives) == 1:
        notes.append("one drive: the interval does not cover differences between drives")
    else:
        notes.append(f"n counts windows of {len(drives)} drives, which are the independent units")
    if floor_source in (_NOISE, "mixed"):
        notes.append(
            "the noise floor contains only the noise of the real poses; repeat real drives with "
            "the same commands to include the variation of reality"
        )
    return tuple(notes)
