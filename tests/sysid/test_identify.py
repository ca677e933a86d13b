"""Identification of parameters from drives, with intervals, warnings and the held-out error."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats

from s2rstore.errors import InconclusiveError, RequestError
from s2rtools.sysid.identify import Identification, SysidSettings, identify
from s2rtools.sysid.prediction_error import HeldOut, compared
from s2rtools.sysid.simulators import Planar
from s2rtools.sysid.synthetic_drives import SEVERITIES
from tests.support.silent_reporter import SilentReporter
from tests.sysid.conftest import QUICK, DriveFolder

DEFAULTS = Planar().defaults()
TRUTH = {**DEFAULTS, "latency": 0.02 + 0.8 * SEVERITIES["latency"][1], "mass": 16.0}


def test_parameters_are_identified_within_one_percent(identified):
    for name in ("mass", "friction", "damping"):
        assert identified.values[name] == pytest.approx(TRUTH[name], rel=0.01)
    assert identified.values["latency"] == pytest.approx(TRUTH["latency"], abs=1e-3)


def test_intervals_contain_the_estimate_and_mostly_the_truth(identified):
    estimates = [estimate for estimate in identified.estimates if estimate.name in TRUTH]
    assert all(estimate.low < estimate.value < estimate.high for estimate in estimates)
    assert sum(estimate.low <= TRUTH[estimate.name] <= estimate.high for estimate in estimates) >= 4


def test_the_fit_predicts_held_out_drives_better(identified):
    assert identified.error.helps
    assert identified.error.fitted[0] < 0.5 * identified.error.untuned[0]
    assert not set(identified.fitted) & set(identified.held_out)


def test_the_residuals_are_the_sensor_noise(identified):
    assert identified.problem.sigma[0] == pytest.approx(0.002, rel=0.1)
    assert identified.problem.sigma[2] == pytest.approx(0.003, rel=0.1)
    assert not identified.structure.mismatch
    assert identified.warnings == ()


def test_a_structural_mismatch_is_reported(identified_unequal_wheels):
    assert identified_unequal_wheels.structure.mismatch
    assert any(
        estimate.systematic
        for estimate in identified_unequal_wheels.structure.channels
        if estimate.name == "heading"
    )
    (wheels,) = [
        estimate
        for estimate in identified_unequal_wheels.structure.candidates
        if estimate.name == "wheels"
    ]
    assert wheels.differs
    assert wheels.estimate == pytest.approx(SEVERITIES["wheels"][1], rel=0.2)
    assert any("wheels = 0.0" in line for line in identified_unequal_wheels.warnings)


SHORT = SysidSettings(parameters=("mass", "friction"), seeds=2, evaluations=10)


@pytest.fixture(scope="module")
def short(drive_folder: Callable[..., DriveFolder]) -> tuple[Identification, SilentReporter]:
    """A short search and its reporter."""
    reporter = SilentReporter()
    return identify(drive_folder(latency=0.8, mass=1.0)[1], SHORT, reporter), reporter


def test_unknown_torques_give_ratios_and_a_warning(drive_folder):
    result = identify(drive_folder(efforts=True, latency=0.8, mass=1.0)[1], QUICK, SilentReporter())
    values = {estimate.name: estimate.value for estimate in result.estimates}
    assert values["gain/mass"] == pytest.approx(1 / 16, rel=0.01)
    assert values["damping/mass"] == pytest.approx(8 / 16, rel=0.01)
    assert "mass" not in values
    assert result.conclusive
    assert any("the wheel torques are unknown" in line for line in result.warnings)


def test_the_progress_reaches_its_total(short):
    assert short[1].steps == short[1].total == 20


def test_too_few_drives_are_inconclusive(drive_folder):
    with pytest.raises(InconclusiveError, match="4 drives, 1 of them held out"):
        identify(drive_folder(latency=0.8, mass=1.0)[1][:4], QUICK, SilentReporter())


def test_drives_without_commands_are_rejected(drive_folder):
    drives = [
        dataclasses.replace(drive, commands=None)
        for drive in drive_folder(latency=0.8, mass=1.0)[1]
    ]
    with pytest.raises(RequestError, match=r"drive-00: no commands\.csv"):
        identify(drives, QUICK, SilentReporter())


def test_commands_with_other_channels_are_rejected(drive_folder):
    drives = list(drive_folder(latency=0.8, mass=1.0)[1])
    commands = drives[3].commands
    assert commands is not None
    other = dataclasses.replace(commands, channels={"v": np.zeros(len(commands.time))})
    drives[3] = dataclasses.replace(drives[3], commands=other)
    with pytest.raises(RequestError, match="needs channels left_torque, right_torque or"):
        identify(drives, QUICK, SilentReporter())


def test_windows_longer_than_the_logs_are_inconclusive(drive_folder):
    settings = dataclasses.replace(QUICK, window=30.0)
    with pytest.raises(InconclusiveError, match="no window of 30 s"):
        identify(drive_folder(latency=0.8, mass=1.0)[1], settings, SilentReporter())


def comparison_of(gains: list[list[float]], heading: float = 0.0) -> HeldOut:
    """Windows of drives whose positions improve by `gains` and headings worsen by a share."""
    drives = np.repeat(np.arange(len(gains)), [len(group) for group in gains])
    before = np.full((len(drives), 2), 1.0)
    after = np.stack([1.0 - np.concatenate(gains), before[:, 1] * (1 + heading)], axis=1)
    return compared(before, after, drives)


@pytest.mark.parametrize("drives", [3, 10])
def test_windows_of_one_drive_are_one_unit(drives):
    rng = np.random.default_rng(1)
    offsets = rng.normal(0.02, 0.1, drives)
    few_windows = comparison_of([[offset] * 4 for offset in offsets])
    many_windows = comparison_of([[offset] * 100 for offset in offsets])
    few, many = few_windows.ratio, many_windows.ratio
    assert (many.low, many.high) == pytest.approx((few.low, few.high))
    logs = np.log(1 - offsets)
    margin = stats.t.ppf(0.975, drives - 1) * logs.std(ddof=1) / np.sqrt(drives)
    assert margin <= np.log(few.high / few.value) <= 2 * margin


def test_one_worse_drive_prevents_acceptance():
    assert comparison_of([[0.1] * 20, [0.11] * 20, [0.1] * 20]).helps
    assert not comparison_of([[0.1] * 20, [0.1] * 20, [-0.02] * 20]).helps


def test_a_worse_heading_prevents_acceptance():
    gains = [[0.1, 0.2], [0.11, 0.2], [0.1, 0.2]]
    assert comparison_of(gains, heading=-0.5).helps
    assert comparison_of(gains, heading=0.01).helps
    assert not comparison_of(gains, heading=0.1).helps
