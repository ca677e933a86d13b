"""Identifiability: parameter combinations that the drives do not determine, and range limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from s2rtools.sysid.normal_equations import NormalEquations
from s2rtools.sysid.parameter_space import Space
from s2rtools.sysid.simulators.simulator import Floats, Parameter

_MAX_UNCERTAINTY = 0.05
"""Standard deviation, as a share of the range, above which a combination is undetermined."""
_LOADING = 0.3
"""Smallest component of an eigenvector that counts."""
_MARGIN = 1e-3
"""Distance to an end, as a share of the range, that counts as reaching it."""


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
