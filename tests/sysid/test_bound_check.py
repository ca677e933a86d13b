"""Estimates at the limits of their ranges."""

import numpy as np
import pytest

from s2rtools.sysid.identifiability import at_range_limits
from s2rtools.sysid.parameter_space import space_of
from s2rtools.sysid.simulators import Planar

SPACE = space_of(
    Planar(), ("mass", "drag"), {}, True
)  # the latency is added; drag and latency start at 0


@pytest.mark.parametrize(
    ("name", "value", "low", "high", "reached"),
    [
        ("mass", 0.5, 0.4, 0.6, False), ("mass", 1.0, 1.0, 1.0, True),
        ("mass", 0.9, 0.7, 1.2, True), ("mass", 0.0, 0.0, 0.0, True),
        ("mass", 0.1, -0.1, 0.3, True), ("latency", 0.0, -0.02, 0.02, False),
        ("latency", 0.0, -0.1, -0.05, True), ("latency", 0.9995, 0.9, 0.9999, True),
        ("drag", 0.001, -0.02, 0.02, False),
    ],
)  # fmt: skip
def test_estimates_at_a_range_limit_are_reported(name, value, low, high, reached):
    index = SPACE.names.index(name)
    cube, limits = np.full(3, 0.5), np.array([[0.4] * 3, [0.6] * 3])
    cube[index], limits[0, index], limits[1, index] = value, low, high
    assert at_range_limits(SPACE, cube, limits) == ((name,) if reached else ())
