"""The parameter space as a unit cube: ranges, scales, ratios, and estimates at a limit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.errors import RequestError
from s2rtools.sysid.identifiability import at_range_limits
from s2rtools.sysid.parameter_space import space_of
from s2rtools.sysid.simulators import Planar

points = st.lists(st.floats(0.0, 1.0), min_size=5, max_size=5).map(np.array)


@pytest.mark.parametrize("known", [True, False])
@given(point=points)
def test_natural_values_stay_in_range_and_convert_back(known, point):
    space = space_of(Planar(), None, {}, known)
    natural = space.natural(point)
    for parameter, value in zip(space.parameters, natural, strict=True):
        assert parameter.low * (1 - 1e-9) <= value <= parameter.high * (1 + 1e-9)
    converted = space.cube(dict(zip(space.names, natural.tolist(), strict=True)))
    np.testing.assert_allclose(converted, point, atol=1e-9)


def test_the_start_is_the_default_of_the_simulator():
    for known in (True, False):
        space = space_of(Planar(), None, {}, known)
        values = space.values(space.start())
        assert values == pytest.approx(Planar().defaults())


def test_the_latency_is_always_searched():
    assert space_of(Planar(), ("mass",), {}, True).names == ("mass", "latency")
    with pytest.raises(RequestError, match="latency: always searched"):
        space_of(Planar(), None, {"latency": 0.1}, True)


def test_structural_parameters_are_not_searched_unless_named():
    assert "wheels" not in space_of(Planar(), None, {}, True).names
    assert "wheels" in space_of(Planar(), ("mass", "wheels"), {}, True).names


@pytest.mark.parametrize(
    ("names", "fixed", "line"),
    [
        (("mas",), {}, "mas: no parameter of the simulator planar"),
        (None, {"gravity": 1.0}, "gravity: no parameter"),
        (("mass",), {"mass": 3.0}, "mass: both fixed and searched"),
        (None, {"track": 9.0}, "track=9: out of its range"),
    ],
)
def test_invalid_names_and_values_are_reported(names, fixed, line):
    with pytest.raises(RequestError, match=line):
        space_of(Planar(), names, fixed, True)


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
