"""Normal equations at the optimum: bounds of the parameters, and what the drives do not determine.

Drives are the independent units. The parameters are refitted without each drive by one Gauss-Newton
step from the optimum; near it the fit is linear to well within its error, so no simulation is
needed.
"""

from __future__ import annotations

from dataclasses import dataclass

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
