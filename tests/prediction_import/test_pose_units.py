"""Units and heading conventions are declared or recognised, and compared with the truth."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rstore.records import Bounds
from s2rtools.models.conventions import parse_convention as parse_output_convention
from s2rtools.prediction_import import pose_units
from s2rtools.prediction_import.pose_units import CONVENTIONS, LENGTHS, Units

BOUNDS = Bounds(100.0, -20.0, 130.0, 5.0)


def headings(n: int = 60, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, n)


@pytest.mark.parametrize("unit", LENGTHS)
def test_the_unit_of_positions_around_the_map_is_recognised(unit):
    rng = np.random.default_rng(1)
    metres = rng.uniform([100, -20], [130, 5], (50, 2)) + rng.normal(0, 3, (50, 2))
    found = pose_units.length_unit(None, metres / LENGTHS[unit], BOUNDS, "p.csv")
    assert (found.name, found.is_recognised, found.scale) == (unit, True, LENGTHS[unit])
    assert str(found) == f"{unit} (recognised)"


def test_positions_that_fit_no_unit_need_a_declaration():
    with pytest.raises(RequestError, match=r"p\.csv: positions around .* declare --units"):
        pose_units.length_unit(None, np.full((5, 2), 5e6), BOUNDS, "p.csv")


def test_headings_beyond_a_turn_are_degrees():
    degrees = np.degrees(headings())
    assert pose_units.angle_unit(None, degrees, "p.csv").name == "deg"
    assert pose_units.angle_unit(None, np.radians(degrees) + np.pi, "p.csv").name == "rad"
    assert pose_units.angle_unit("rad", degrees, "p.csv").name == "rad"


def test_few_headings_beyond_a_turn_need_a_declaration():
    with pytest.raises(RequestError, match=r"1\.7% of the headings .*--units rad or --units deg"):
        pose_units.angle_unit(None, np.append(headings(59), 7.0), "p.csv")


@given(st.floats(-10, 10), st.sampled_from(sorted(CONVENTIONS)))
def test_a_formula_gives_the_map_heading(heading, name):
    offset, sign = name.replace("-h", "+-1").replace("+h", "+1").split("+")
    expected = math.radians(float(offset)) + float(sign) * heading
    (found,) = pose_units.to_map(np.array([heading]), name)
    assert -np.pi <= found < np.pi
    assert math.isclose(float(angles.distance(found, expected)), 0, abs_tol=1e-9)


def test_habitat_is_the_convention_of_the_models():
    import torch

    h = headings()
    convention = parse_output_convention("radians,habitat")
    expected = convention.decode(torch.tensor(np.column_stack([h, h, h])))[:, 2].numpy()
    found = pose_units.to_map(h, pose_units.parse_convention("habitat"))
    assert angles.distance(found, expected).max() < 1e-6
    assert angles.distance(found, angles.from_habitat(h)).max() < 1e-12


@pytest.mark.parametrize("true_convention", sorted(CONVENTIONS))
def test_auto_finds_the_convention_and_a_warning_names_it(true_convention):
    truth = headings()
    noise = np.random.default_rng(3).normal(0, 0.2, truth.size)
    offset, sign = CONVENTIONS[true_convention]
    given_headings = sign * (truth + noise - math.radians(offset))
    errors = pose_units.heading_errors(given_headings, truth)
    assert pose_units.best_convention(errors, truth.size, "p.csv") == true_convention
    warnings = pose_units.convention_warnings(given_headings, "rad", "0+h", truth, "p.csv")
    if true_convention == "0+h":
        assert warnings == ()
    else:
        assert f"--heading {true_convention} " in warnings[0]


def test_auto_is_refused_where_all_conventions_are_alike():
    errors = pose_units.heading_errors(headings(seed=1), headings(seed=2))
    with pytest.raises(RequestError, match="--heading auto: no convention fits clearly better"):
        pose_units.best_convention(errors, 60, "p.csv")


def test_a_few_rows_are_not_judged():
    truth = headings(9)
    assert pose_units.convention_warnings(truth + np.pi, "rad", "0+h", truth, "p.csv") == ()
    with pytest.raises(RequestError, match="9 rows"):
        pose_units.best_convention(pose_units.heading_errors(truth, truth), 9, "p.csv")


def test_a_warning_names_the_other_unit():
    truth = np.random.default_rng(5).uniform(1, 3, 40)
    (warning,) = pose_units.convention_warnings(truth, "deg", "0+h", truth, "p.csv")
    assert "--units rad" in warning


def test_units_are_parsed_in_any_order():
    assert pose_units.parse_units("deg, mm,ns") == Units("mm", "deg", "ns")
    assert pose_units.parse_units("") == Units(None, None, "s")


@pytest.mark.parametrize(("text", "message"), [
    ("feet", r"--units feet: one of m, cm, mm, rad, deg, s, ms, us, ns"),
    ("m,mm", r"--units m,mm: m and mm; name one length"),
])  # fmt: skip
def test_wrong_units_are_refused(text, message):
    with pytest.raises(RequestError, match=message):
        pose_units.parse_units(text)


def test_a_wrong_convention_is_refused():
    with pytest.raises(RequestError, match=r"--heading north: one of 0\+h, 90\+h"):
        pose_units.parse_convention("north")
