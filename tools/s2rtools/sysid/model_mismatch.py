"""Whether the best fit leaves more than noise, and which structural parameter would explain it.

Residuals of held-out windows are white where the simulator can follow reality and sensors add
independent noise; their mean autocorrelation over short lags is compared with what white noise of
so many samples gives. Then every structural parameter that was not searched (a way in which
reality may differ that is no tuning knob) is given one Gauss-Newton step beside the searched ones
(a score test); its interval is by bootstrap over all drives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from s2rtools.sysid.drive_bootstrap import drive_interval, normal_equations, refit_replicates
from s2rtools.sysid.prediction_error import PredictionError
from s2rtools.sysid.simulators.simulator import Floats

CHANNELS = ("ahead", "sideways", "heading")
_LAGS = 10
_SURE = 0.999
_LEVEL = 0.99


@dataclass(frozen=True, slots=True)
class Channel:
    """Mean autocorrelation over the first lags, and the most that noise gives; `rms` in m, rad."""

    name: str
    autocorrelation: float
    limit: float
    rms: float

    @property
    def systematic(self) -> bool:
        return self.autocorrelation > self.limit


@dataclass(frozen=True, slots=True)
class Candidate:
    """What one more parameter would have to be; `nominal` is what the fit took it to be."""

    name: str
    nominal: float
    estimate: float
    low: float
    high: float

    @property
    def differs(self) -> bool:
        """Where the drives know too little of it, the interval leaves out the estimate itself."""
        known = self.low <= self.estimate <= self.high
        return known and not self.low <= self.nominal <= self.high


@dataclass(frozen=True, slots=True)
class Structure:
    channels: tuple[Channel, ...]
    candidates: tuple[Candidate, ...]

    @property
    def mismatch(self) -> bool:
        return any(channel.systematic for channel in self.channels) or any(
            candidate.differs for candidate in self.candidates
        )

    def sentences(self) -> tuple[str, ...]:
        """What to tell the reader; empty where nothing was found."""
        told = []
        systematic = [channel for channel in self.channels if channel.systematic]
        if systematic:
            parts = ", ".join(
                f"{one.name} {one.autocorrelation:.2f} (noise: at most {one.limit:.2f})"
                for one in systematic
            )
            told.append(
                "structural mismatch: on held-out drives the best fit leaves systematic residuals; "
                f"mean autocorrelation {parts}"
            )
        told.extend(
            f"structural mismatch: {one.name} = {one.estimate:.3g} ({one.low:.3g} .. "
            f"{one.high:.3g}) would explain residuals that the fit with {one.name} = "
            f"{one.nominal:.3g} leaves"
            for one in self.candidates
            if one.differs
        )
        return tuple(told)


def structure(held_out: PredictionError, everything: PredictionError, cube: Floats, count: int,
              rng: np.random.Generator) -> Structure:  # fmt: skip
    """`held_out` and `everything`: the problem over held-out windows and over all."""
    return Structure(_channels(held_out, cube), _candidates(everything, cube, count, rng))


def _channels(problem: PredictionError, cube: Floats) -> tuple[Channel, ...]:
    from scipy.stats import norm

    problem = problem.restarted(cube)
    rows = problem.residuals(cube)
    heading = problem.windows.poses[:, 2]
    cos, sin = np.cos(heading), np.sin(heading)
    turned = np.stack([cos * rows[:, 0] + sin * rows[:, 1],
                       cos * rows[:, 1] - sin * rows[:, 0], rows[:, 2]], axis=1)  # fmt: skip
    window = problem.windows.window_of_row
    found = []
    tail = float(norm.ppf(1 - (1 - _SURE) / len(CHANNELS)))
    for name, values, sigma in zip(CHANNELS, turned.T, problem.sigma, strict=True):
        total, pairs = 0.0, 0.0
        for lag in range(1, _LAGS + 1):
            inside = window[lag:] == window[:-lag]
            total += float((values[lag:] * values[:-lag])[inside].sum())
            pairs += int(inside.sum())
        variance = float((values**2).mean())
        correlation = total / pairs / variance if variance > 0 else 0.0
        found.append(Channel(name, correlation, tail / float(np.sqrt(pairs)),
                             float(np.sqrt(variance) * sigma)))  # fmt: skip
    return tuple(found)


def _candidates(problem: PredictionError, cube: Floats, count: int,
                rng: np.random.Generator) -> tuple[Candidate, ...]:  # fmt: skip
    space = problem.space
    found = []
    for declared in space.simulator.parameters:
        if declared.name not in space.fixed or not declared.structural:
            continue
        wide = space.widened(declared.name)
        point = np.append(cube, wide.start()[-1])
        wider = problem.over(wide).restarted(point)
        normal = normal_equations(wider, point)
        refits = refit_replicates(normal, point, count, rng)
        centre = point - np.linalg.solve(normal.matrices.sum(axis=0) + 1e-9 * np.eye(len(point)),
                                         normal.vectors.sum(axis=0))  # fmt: skip
        low, high = drive_interval(refits, _LEVEL, len(normal.vectors))
        told = wide.natural(np.clip(np.stack([centre, low, high]), 0.0, 1.0))[:, -1]
        found.append(Candidate(declared.name, space.fixed[declared.name], *map(float, told)))
    return tuple(found)
