"""Which combinations of parameters the drives leave open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from s2rtools.sysid.drive_bootstrap import NormalEquations
from s2rtools.sysid.parameter_space import Space
from s2rtools.sysid.simulators.simulator import Floats, Parameter

_OPEN = 0.05
"""Standard deviation, as a share of the declared range, from which a combination is open."""
_LOADING = 0.3


@dataclass(frozen=True, slots=True)
class Identifiability:
    """`eigenvalues` (p,) of the Fisher information in cube coordinates, ascending; `uncertainty`
    (p,): the standard deviation along each eigenvector as a share of the ranges; `open_names`:
    parameters that take part in an open combination; `warnings` name the combinations.
    """

    eigenvalues: Floats
    uncertainty: Floats
    condition: float
    open_names: tuple[str, ...]
    warnings: tuple[str, ...]


def identifiability(normal: NormalEquations, space: Space) -> Identifiability:
    """From normal equations in units of the residuals' noise."""
    values, vectors = np.linalg.eigh(normal.matrices.sum(axis=0))
    floor = max(float(values[-1]), 1.0) * 1e-15
    values = np.maximum(values, floor)
    uncertainty = 1.0 / np.sqrt(values)
    names: list[str] = []
    warnings = []
    for share, vector in zip(uncertainty, vectors.T, strict=True):
        if share <= _OPEN:
            continue
        strong = [i for i in np.argsort(-np.abs(vector)) if abs(vector[i]) >= _LOADING]
        names.extend(space.names[i] for i in strong)
        warnings.append(_warning(space, vector, strong, float(share)))
    return Identifiability(values, uncertainty, float(values[-1] / values[0]),
                           tuple(dict.fromkeys(names)), tuple(warnings))  # fmt: skip


def _warning(space: Space, vector: Floats, strong: list[int], share: float) -> str:
    told = ", ".join(
        f"{space.names[i]} {'up' if vector[i] * vector[strong[0]] > 0 else 'down'}" for i in strong
    )
    reach = "more than its whole range" if share > 1 else f"+-{100 * share:.0f} % of its range"
    if len(strong) == 1:
        return f"{space.names[strong[0]]} is not determined by these drives ({reach})"
    ratio = ""
    shared = set(space.simulator.shared)
    if len(strong) > 1 and {space.names[i] for i in strong} <= shared:
        ratio = "; only their ratios are known"
    return f"not determined together ({reach}): {told}{ratio}"


_NEAR = 1e-3
"""Of the range."""


def at_ends(space: Space, cube: Floats, limits: Floats) -> tuple[str, ...]:
    """Parameters whose estimate (p,) or one of whose limits (2, p), not cut, reaches an end.

    A range that begins at 0 begins where nature does: there only an interval that lies wholly
    outside counts.
    """
    found = []
    for one, value, (low, high) in zip(space.parameters, cube, limits.T, strict=True):
        natural = one.low == 0
        below = high <= -_NEAR if natural else min(value, low) <= _NEAR
        if below or max(value, high) >= 1 - _NEAR:
            found.append(one.name)
    return tuple(found)


def end_warning(one: Parameter, value: float) -> str:
    """For the reader."""
    unit = "" if one.unit == "1" else f" {one.unit}"
    return (
        f"{one.name}: the estimate {value:.4g}{unit} or its interval reaches the end of the range "
        f"{one.low:g} .. {one.high:g}{unit}; the truth may lie outside, so search another range"
    )
