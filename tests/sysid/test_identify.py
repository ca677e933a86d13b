"""From drives to parameters, with intervals and warnings."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from s2rstore.errors import InconclusiveError, RequestError
from s2rtools.sysid import Identification, SysidSettings, identify, record
from s2rtools.sysid.simulators import Planar
from s2rtools.sysid.synthetic_drives import SEVERITIES
from tests.sysid.conftest import QUICK, Made, Silent

DEFAULTS = Planar().defaults()
TRUTH = {**DEFAULTS, "latency": 0.02 + 0.8 * SEVERITIES["latency"][1], "mass": 16.0}


def test_parameters_come_back_within_a_percent(plain: Identification) -> None:
    for name in ("mass", "friction", "damping"):
        assert plain.values[name] == pytest.approx(TRUTH[name], rel=0.01)
    assert plain.values["latency"] == pytest.approx(TRUTH["latency"], abs=1e-3)


def test_intervals_hold_the_estimate_and_nearly_always_the_truth(plain: Identification) -> None:
    estimates = [one for one in plain.estimates if one.name in TRUTH]
    assert all(one.low < one.value < one.high for one in estimates)
    assert sum(one.low <= TRUTH[one.name] <= one.high for one in estimates) >= 4


def test_the_fit_predicts_held_out_drives_better(plain: Identification) -> None:
    assert plain.error.helps
    assert plain.error.fitted[0] < 0.5 * plain.error.untuned[0]
    assert not set(plain.fitted) & set(plain.held_out)


def test_what_is_left_is_the_noise_of_the_sensors(plain: Identification) -> None:
    assert plain.problem.sigma[0] == pytest.approx(0.002, rel=0.1)
    assert plain.problem.sigma[2] == pytest.approx(0.003, rel=0.1)
    assert not plain.structure.mismatch
    assert plain.warnings == ()


def test_a_structural_mismatch_is_told_and_named(unequal: Identification) -> None:
    assert unequal.structure.mismatch
    assert any(one.systematic for one in unequal.structure.channels if one.name == "heading")
    (wheels,) = [one for one in unequal.structure.candidates if one.name == "wheels"]
    assert wheels.differs
    assert wheels.estimate == pytest.approx(SEVERITIES["wheels"][1], rel=0.2)
    assert any("wheels = 0.0" in line for line in unequal.warnings)


def test_the_mismatch_is_gone_once_it_is_searched(made: Callable[..., Made]) -> None:
    names = ("mass", "friction", "damping", "drag", "wheels")
    drives = made(latency=0.8, wheels=1.0)[1]
    found = identify(drives, dataclasses.replace(QUICK, parameters=names), Silent())
    assert not found.structure.mismatch
    assert found.values["wheels"] == pytest.approx(SEVERITIES["wheels"][1], rel=0.05)


SHORT = SysidSettings(seeds=2, evaluations=30)


@pytest.fixture(scope="module")
def short(made: Callable[..., Made]) -> tuple[Identification, Silent]:
    """A search that hardly begins, and what it told."""
    told = Silent()
    return identify(made(latency=0.8, mass=1.0)[1], SHORT, told), told


def test_one_seed_gives_the_same_record(
    made: Callable[..., Made], short: tuple[Identification, Silent]
) -> None:
    again = identify(made(latency=0.8, mass=1.0)[1], SHORT, Silent())
    assert record(again) == record(short[0])


def test_unknown_torques_give_ratios_and_say_so(made: Callable[..., Made]) -> None:
    found = identify(made(efforts=True, latency=0.8, mass=1.0)[1], QUICK, Silent())
    values = {one.name: one.value for one in found.estimates}
    assert values["gain/mass"] == pytest.approx(1 / 16, rel=0.01)
    assert values["damping/mass"] == pytest.approx(8 / 16, rel=0.01)
    assert "mass" not in values
    assert found.conclusive
    assert any("the wheel torques are unknown" in line for line in found.warnings)


def test_a_flat_combination_is_named_and_ends_the_trust(made: Callable[..., Made]) -> None:
    drives = made(latency=0.8, mass=1.0)[1]
    names = ("mass", "gain", "friction", "damping", "drag")
    found = identify(drives, dataclasses.replace(QUICK, parameters=names), Silent())
    assert not found.conclusive
    assert {"mass", "gain", "damping"} <= set(found.identifiability.undetermined)
    (warning,) = found.identifiability.warnings
    assert "only their ratios are known" in warning
    mass = next(one for one in found.estimates if one.name == "mass")
    assert (mass.low, mass.high) == (2.0, 60.0)


def test_progress_adds_up(short: tuple[Identification, Silent]) -> None:
    assert short[1].done == short[1].total == 60


def test_too_few_drives_are_inconclusive(made: Callable[..., Made]) -> None:
    with pytest.raises(InconclusiveError, match="4 drives, 1 of them held out"):
        identify(made(latency=0.8, mass=1.0)[1][:4], QUICK, Silent())


def test_drives_without_commands_are_refused(made: Callable[..., Made]) -> None:
    drives = [dataclasses.replace(one, commands=None) for one in made(latency=0.8, mass=1.0)[1]]
    with pytest.raises(RequestError, match=r"drive-00: no commands\.csv"):
        identify(drives, QUICK, Silent())


def test_commands_of_other_channels_are_refused(made: Callable[..., Made]) -> None:
    drives = list(made(latency=0.8, mass=1.0)[1])
    told = drives[3].commands
    assert told is not None
    other = dataclasses.replace(told, channels={"v": np.zeros(len(told.time))})
    drives[3] = dataclasses.replace(drives[3], commands=other)
    with pytest.raises(RequestError, match="needs channels left_torque, right_torque or"):
        identify(drives, QUICK, Silent())


def test_windows_longer_than_the_logs_are_inconclusive(made: Callable[..., Made]) -> None:
    settings = dataclasses.replace(QUICK, window=30.0)
    with pytest.raises(InconclusiveError, match="no window of 30 s"):
        identify(made(latency=0.8, mass=1.0)[1], settings, Silent())
