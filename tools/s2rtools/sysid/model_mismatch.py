"""Test for model mismatch: systematic residuals, and structural parameters that would explain them.

If the simulator can follow reality and sensor noise is independent, residuals of held-out windows
are white. Their mean autocorrelation over short lags is compared with its upper limit for white
noise. Then one Gauss-Newton step estimates each fixed structural parameter together with the
searched ones (a score test), with an interval over all drives.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from s2rtools.sysid.identifiability import normal_equations, parameter_bounds
from s2rtools.sysid.prediction_error import PredictionError
from s2rtools.sysid.simulators.simulator import Floats

CHANNELS = ("ahead", "sideways", "heading")
_LAGS = 10
_NOISE_LEVEL = 0.999
"""Confidence level of the limit for noise, over all channels."""
_LEVEL = 0.99
"""Confidence level of the candidates' intervals."""


@dataclass(frozen=True, slots=True)
class Channel:
    """Mean autocorrelation over short lags, its upper limit for noise, and `rms` in m or rad."""

    name: str
    autocorrelation: float
    limit: float
    rms: float

    @property
    def systematic(self) -> bool:
        return self.autocorrelation > self.limit


@dataclass(frozen=True, slots=True)
class Candidate:
    """Estimate of a structural parameter that the fit held at its value `nominal`."""

    name: str
    nominal: float
    estimate: float
    low: float
    high: float

    @property
    def differs(self) -> bool:
        """Whether the interval holds the estimate and excludes the nominal value.

        It excludes the estimate where the drives hold too little evidence.
        """
        determined = self.low <= self.estimate <= self.high
        return determined and not self.low <= self.nominal <= self.high


@dataclass(frozen=True, slots=True)
class Structure:
    """Result of the test for model mismatch."""

    channels: tuple[Channel, ...]
    candidates: tuple[Candidate, ...]

    @property
    def mismatch(self) -> bool:
        return bool(self.sentences())

    def sentences(self) -> tuple[str, ...]:
        """One warning per kind of mismatch; empty without a mismatch."""
        warnings = []
        systematic = [channel for channel in self.channels if channel.systematic]
        if systematic:
            parts = ", ".join(
                f"{one.name} {one.autocorrelation:.2f} (noise: at most {one.limit:.2f})"
                for one in systematic
            )
            warnings.append(
                "structural mismatch: on held-out drives the best fit leaves systematic residuals; "
                f"mean autocorrelation {parts}"
            )
        warnings.extend(
            f"structural mismatch: {one.name} = {one.estimate:.3g} ({one.low:.3g} .. "
            f"{one.high:.3g}) would explain residuals that the fit with {one.name} = "
            f"{one.nominal:.3g} leaves"
            for one in self.candidates
            if one.differs
        )
        return tuple(warnings)


def structure(held_out: PredictionError, everything: PredictionError, cube: Floats) -> Structure:
    """Test for model mismatch at the fitted parameters `cube`, in unit-cube coordinates.

    Residuals come from the held-out windows, candidate terms from all windows.
    """
    return Structure(_channels(held_out, cube), _candidates(everything, cube))


def _channels(problem: PredictionError, cube: Floats) -> tuple[Channel, ...]:
    from scipy.stats import norm

    problem = problem.restarted(cube)
    rows = problem.residuals(cube)
    heading = problem.windows.poses[:, 2]
    cos, sin = np.cos(heading), np.sin(heading)
    turned = np.stack([cos * rows[:, 0] + sin * rows[:, 1],
                       cos * rows[:, 1] - sin * rows[:, 0], rows[:, 2]], axis=1)  # fmt: skip
    window = problem.windows.window_of_row
    channels = []
    tail = float(norm.ppf(1 - (1 - _NOISE_LEVEL) / len(CHANNELS)))
    for name, values, sigma in zip(CHANNELS, turned.T, problem.sigma, strict=True):
        total, pairs = 0.0, 0.0
        for lag in range(1, _LAGS + 1):
            inside = window[lag:] == window[:-lag]
            total += float((values[lag:] * values[:-lag])[inside].sum())
            pairs += int(inside.sum())
        variance = float((values**2).mean())
        correlation = total / pairs / variance if variance > 0 else 0.0
        channels.append(Channel(name, correlation, tail / float(np.sqrt(pairs)),
                                float(np.sqrt(variance) * sigma)))  # fmt: skip
    return tuple(channels)


def _candidates(problem: PredictionError, cube: Floats) -> tuple[Candidate, ...]:
    space = problem.space
    candidates = []
    for declared in space.simulator.parameters:
        if declared.name not in space.fixed or not declared.structural:
            continue
        wide = space.widened(declared.name)
        point = np.append(cube, wide.start()[-1])
        wider = replace(problem, space=wide).restarted(point)
        normal = normal_equations(wider, point)
        centre = point - np.linalg.solve(normal.matrices.sum(axis=0) + 1e-9 * np.eye(len(point)),
                                         normal.vectors.sum(axis=0))  # fmt: skip
        low, high = parameter_bounds(normal, point, _LEVEL)
        values = wide.natural(np.clip(np.stack([centre, low, high]), 0.0, 1.0))[:, -1]
        candidates.append(Candidate(declared.name, space.fixed[declared.name], *values.tolist()))
    return tuple(candidates)
