"""Estimates at the end of their range, where the range decided and not the drives."""

from __future__ import annotations

from s2rtools.sysid.parameter_space import Space
from s2rtools.sysid.simulators.simulator import Floats, Parameter

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
