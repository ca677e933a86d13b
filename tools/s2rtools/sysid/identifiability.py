"""Normal equations at the optimum: bounds of the parameters, and what the drives do not determine.

Drives are the independent units. The parameters are refitted without each drive by one Gauss-Newton
step from the optimum; near it the fit is linear to well within its error, so no simulation is
needed.

The test for model mismatch looks for systematic residuals, and for structural parameters that would
explain them. If the simulator can follow reality and sensor noise is independent, residuals of
held-out windows are white. Their mean autocorrelation over short lags is compared with its upper
limit for white noise. Then one Gauss-Newton step estimates each fixed structural parameter together
with the searched ones (a score test), with an interval over all drives.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from s2rstore.intervals import of_units
from s2rtools.sysid.parameter_space import Space
from s2rtools.sysid.prediction_error import PredictionError
from s2rtools.sysid.simulators.simulator import Floats, Parameter

_PRIOR = 12.0
"""Prior precision of a normalised parameter: 1 / variance of the uniform distribution on 0 .. 1."""
_MAX_UNCERTAINTY = 0.05
"""Standard deviation, as a share of the range, above which a combination is undetermined."""
_LOADING = 0.3
"""Smallest component of an eigenvector that counts."""
_MARGIN = 1e-3
"""Distance to an end, as a share of the range, that counts as reaching it."""
CHANNELS = ("ahead", "sideways", "heading")
_LAGS = 10
_NOISE_LEVEL = 0.999
"""Confidence level of the limit for noise, over all channels."""
_LEVEL = 0.99
"""Confidence level of the candidates' intervals."""


@dataclass(frozen=True, slots=True)
class NormalEquations:
    """Normal equations per drive at a point: `matrices` (d, p, p) and `vectors` (d, p); drives
    without windows are left out."""

    matrices: Floats
    vectors: Floats


def normal_equations(problem: PredictionError, cube: Floats) -> NormalEquations:
    residual, slope = problem.residuals(cube), problem.jacobian(cube)
    drives = problem.windows.drive_of_row
    matrices, vectors = [], []
    for drive in np.unique(drives):
        rows = slope[drives == drive].reshape(-1, len(cube))
        matrices.append(rows.T @ rows)
        vectors.append(rows.T @ residual[drives == drive].ravel())
    return NormalEquations(np.stack(matrices), np.stack(vectors))


def refits_without_each(normal: NormalEquations, cube: Floats) -> Floats:
    """Normalised parameters (d, p) refitted without each drive, not clipped to [0, 1]."""
    matrices = normal.matrices.sum(axis=0) - normal.matrices + _PRIOR * np.eye(len(cube))
    vectors = normal.vectors.sum(axis=0) - normal.vectors
    return np.asarray(cube - np.linalg.solve(matrices, vectors[:, :, None])[:, :, 0])


def parameter_bounds(normal: NormalEquations, cube: Floats, level: float) -> Floats:
    """Bounds (2, p) of normalised parameters at a level, around one step from `cube`.

    They exclude a value of `cube` that the normal equations would move by more than its noise.
    """
    refits = refits_without_each(normal, cube)
    intervals = [
        of_units(float(column.mean()), column, unit="drives", level=level) for column in refits.T
    ]
    return np.array([[each.low for each in intervals], [each.high for each in intervals]])


@dataclass(frozen=True, slots=True)
class Identifiability:
    """Fisher information in normalised parameters: `eigenvalues` (p,), ascending, and the standard
    deviation along each eigenvector as a share of the ranges, `uncertainty` (p,). `undetermined`
    are the parameters of undetermined combinations, which `warnings` describe.
    """

    eigenvalues: Floats
    uncertainty: Floats
    condition: float
    undetermined: tuple[str, ...]
    warnings: tuple[str, ...]


def identifiability(normal: NormalEquations, space: Space) -> Identifiability:
    """Analyse normal equations in units of the residuals' noise."""
    values, vectors = np.linalg.eigh(normal.matrices.sum(axis=0))
    floor = max(float(values[-1]), 1.0) * 1e-15
    values = np.maximum(values, floor)
    uncertainty = 1.0 / np.sqrt(values)
    names: list[str] = []
    warnings = []
    for share, vector in zip(uncertainty.tolist(), vectors.T, strict=True):
        if share <= _MAX_UNCERTAINTY:
            continue
        strong = [i for i in np.argsort(-np.abs(vector)) if abs(vector[i]) >= _LOADING]
        names.extend(space.names[i] for i in strong)
        warnings.append(_warning(space, vector, strong, share))
    return Identifiability(values, uncertainty, float(values[-1] / values[0]),
                           tuple(dict.fromkeys(names)), tuple(warnings))  # fmt: skip


def _warning(space: Space, vector: Floats, strong: list[int], share: float) -> str:
    directions = ", ".join(
        f"{space.names[i]} {'up' if vector[i] * vector[strong[0]] > 0 else 'down'}" for i in strong
    )
    reach = "more than its whole range" if share > 1 else f"+-{100 * share:.0f} % of its range"
    if len(strong) == 1:
        return f"{space.names[strong[0]]} is not determined by these drives ({reach})"
    scalable = {space.names[i] for i in strong} <= set(space.simulator.shared)
    ratio = "; only their ratios are known" if scalable else ""
    return f"these parameters are not determined separately ({reach}): {directions}{ratio}"


def at_range_limits(space: Space, cube: Floats, limits: Floats) -> tuple[str, ...]:
    """Parameters whose estimate (p,) or unclipped interval (2, p) reaches an end of the range.

    A lower end of 0 is a physical limit: there only an interval that lies wholly outside counts.
    """
    names = []
    for one, value, (low, high) in zip(space.parameters, cube, limits.T, strict=True):
        physical = one.low == 0
        below = high <= -_MARGIN if physical else min(value, low) <= _MARGIN
        if below or max(value, high) >= 1 - _MARGIN:
            names.append(one.name)
    return tuple(names)


def range_warning(one: Parameter, value: float) -> str:
    """The warning for an estimate at a range limit."""
    unit = "" if one.unit == "1" else f" {one.unit}"
    return (
        f"{one.name}: the estimate {value:.4g}{unit} or its interval reaches the end of the range "
        f"{one.low:g} .. {one.high:g}{unit}; the true value may lie outside, so "
        "search another range (--range)"
    )


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
