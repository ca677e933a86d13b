"""The dynamics and delay axes respond to motion errors and delays; the size of noisy delays."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import s2rstore
from bench.support import robot
from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.intervals import Interval
from s2rtools.gap.axis import Anchor, Axis, AxisResult, Evidence, GapSettings
from s2rtools.gap.delay import delay_axis, time_delay
from s2rtools.gap.delay.delay_axis import DelayAxis
from s2rtools.gap.dynamics.dynamics_axis import DynamicsAxis
from s2rtools.gap.dynamics.windows import WindowPlan
from s2rtools.motion_logs import Drive
from s2rtools.motion_logs.motion_log import RigidTransform

SETTINGS = GapSettings()


@pytest.fixture(scope="module")
def evidence(tiny_store: Path):
    """Evidence of these drives."""
    with s2rstore.open(tiny_store) as store:
        yield lambda drives: Evidence(store, "vanilla", np.arange(3), drives=drives)


def drives(count: int = 1, **real: float) -> list[Drive]:
    return [robot.pair(seed, untuned=0.15, **real) for seed in range(count)]


def gap(measured: AxisResult, anchor: Anchor) -> tuple[float, float, float]:
    """G in percent with its bounds."""
    found = measured.bounds(SETTINGS.level).scaled(100 / anchor.interval.value)
    return found.value, found.low, found.high


def judged_gap(axis: Axis, evidence: Evidence) -> tuple[float, float, float]:
    return gap(axis.measure(evidence, SETTINGS), axis.anchor(evidence, SETTINGS))


def test_latency_affects_only_the_delay_axis(evidence):
    delayed = evidence(drives(3, delay=0.08))
    measured = DelayAxis().measure(delayed, SETTINGS)
    assert measured.value == pytest.approx(0.08 / robot.PERIOD, rel=0.02)
    assert measured.details["delay"] == pytest.approx(0.08, abs=1e-3)
    assert measured.details["delay_low"] <= 0.0805
    assert measured.details["delay_high"] >= 0.0795
    assert judged_gap(DynamicsAxis(), delayed)[2] < 3


def test_motion_errors_affect_only_the_dynamics_axis(evidence):
    slower = evidence(drives(2, delay=0.0, gain=0.85, turn_gain=0.9))
    assert judged_gap(DynamicsAxis(), slower)[1] > 15
    assert judged_gap(DelayAxis(), slower)[2] < 3


def test_the_delay_anchor_and_the_sign_of_a_delay_are_reported(evidence):
    early = DelayAxis().measure(evidence(drives(1, delay=-0.04)), SETTINGS)
    assert early.details["delay"] == pytest.approx(-0.04, abs=1e-3)
    assert early.value == pytest.approx(0.8, rel=0.05)
    assert early.floor == 0
    several = evidence(drives(1))
    assert DelayAxis(bad="untuned").anchor(several, SETTINGS).interval.value > 3
    default_anchor = DelayAxis().anchor(several, SETTINGS)
    assert default_anchor.interval == Interval(1.0, 1.0, 1.0)


def test_nrmse_of_a_known_error(evidence):
    plan = WindowPlan(horizons=(0.5, 1.0))
    measured = DynamicsAxis(plan).measure(
        evidence(drives(1, delay=0.0, gain=0.9, noise=0.0, turn_noise=0.0)), SETTINGS
    )
    assert measured.value == pytest.approx(1 / 0.9 - 1, rel=0.1)
    assert measured.floor < 0.005
    rows = measured.details["horizons"]
    assert [row["horizon"] for row in rows] == [0.5, 1.0]
    for row in rows:
        assert row["nrmse"] == pytest.approx(row["rmse"] / row["scale"])
        assert row["nrmse_low"] < row["nrmse"] < row["nrmse_high"]
    assert measured.value == pytest.approx(np.mean([row["nrmse"] for row in rows]))
    assert measured.n == sum(row["windows"] for row in rows)


def test_repeated_real_drives_define_the_floor(evidence):
    commands = robot.commands(30.0, np.random.default_rng(0))
    sim = robot.sampled(robot.drive(commands))
    repeated_drives = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        real = robot.sampled(robot.drive(commands, slip=0.02, rng=rng), 50, 0.001, 0.001, rng)
        later = replace(commands, time=commands.time + 100 * seed)
        real, other = (replace(log, time=log.time + 100 * seed) for log in (real, sim))
        repeated_drives.append(Drive(f"d{seed}", real, other, None, later))
    repeated = DynamicsAxis().measure(evidence(repeated_drives), SETTINGS)
    assert repeated.fingerprint["floor_from"] == "repeated real drives"
    single = DynamicsAxis().measure(evidence(repeated_drives[:1]), SETTINGS)
    assert single.fingerprint["floor_from"] == "noise of the poses"
    floors = [result.details["floor_nrmse"] for result in (repeated, single)]
    assert floors[0] > 2 * floors[1]
    assert repeated.value < 0.5 * single.value
    mixed = DynamicsAxis().measure(evidence([*repeated_drives, robot.pair(9)]), SETTINGS)
    assert mixed.fingerprint["floor_from"] == "mixed"


def test_the_anchor_of_equal_logs_is_the_measure(evidence):
    several = evidence(drives(3, gain=0.9))
    measured = DynamicsAxis().measure(several, SETTINGS)
    same = [replace(d, untuned=d.sim) for d in several.drives]
    anchor = DynamicsAxis().anchor(evidence(same), SETTINGS)
    assert anchor.interval == measured.bounds(SETTINGS.level)


def test_missing_evidence_is_explained(evidence):
    without_drives = evidence([])
    assert "no drives" in (DynamicsAxis().missing(without_drives) or "")
    assert "no drives" in (DelayAxis().missing(without_drives) or "")
    without_commands = evidence([replace(robot.pair(1), commands=None)])
    assert DynamicsAxis().missing(without_commands) is None
    assert "commands.csv" in (DelayAxis().missing(without_commands) or "")
    assert DelayAxis(period=0.1).missing(without_commands) is None
    measured = DelayAxis(period=0.1).measure(without_commands, SETTINGS)
    assert measured.value == pytest.approx(0.3, rel=0.1)
    for axis in (DynamicsAxis(), DelayAxis(bad="untuned")):
        with pytest.raises(RequestError, match=r"drive drive1 has no untuned\.\*"):
            axis.anchor(evidence([robot.pair(1)]), SETTINGS)


def test_unequal_periods_and_short_drives_are_rejected(evidence):
    a, b = drives(2)
    assert b.commands is not None
    other = replace(b, commands=replace(b.commands, period=0.1))
    with pytest.raises(RequestError, match=r"0\.05 s in drive drive0, 0\.1 s in drive1"):
        DelayAxis().measure(evidence([a, other]), SETTINGS)
    short = evidence([robot.pair(1, seconds=5.0)])
    with pytest.raises(InconclusiveError, match=r"windows of 5 s in the drives, 8 are needed"):
        DynamicsAxis().measure(short, SETTINGS)


def thin_log(drive: Drive, rate: float, side: str) -> Drive:
    """The drive with one log thinned to `rate` Hz."""
    log = getattr(drive, side)
    rows = slice(None, None, round(50 / rate))
    columns = {name: getattr(log, name)[rows] for name in ("time", "x", "y", "heading")}
    return replace(drive, **{side: replace(log, **columns)})


@pytest.mark.parametrize("side", ["real", "sim"])
def test_too_coarse_poses_are_inconclusive(evidence, side):
    drive = robot.pair(1, seconds=60.0, gain=0.9)
    coarse = evidence([thin_log(drive, 1.0, side)])
    with pytest.raises(InconclusiveError, match=r"poses every 1 s are too coarse .* record one"):
        DynamicsAxis().measure(coarse, SETTINGS)
    assert DynamicsAxis().measure(evidence([thin_log(drive, 10.0, side)]), SETTINGS).value > 0.05


def test_motion_that_looks_like_noise_is_inconclusive(evidence):
    drive = robot.pair(1, seconds=60.0, gain=0.9, noise=0.0, turn_noise=0.0)
    coarse = evidence([thin_log(drive, 1.0, "real")])
    with pytest.raises(InconclusiveError, match="noise cannot be separated from motion"):
        DynamicsAxis(WindowPlan(horizons=(4.0, 8.0))).measure(coarse, SETTINGS)


def test_a_robot_that_turns_in_place_is_inconclusive(evidence):
    for noise in (0.0, 0.002):
        commands = robot.commands(20.0, np.random.default_rng(1))
        turning = replace(commands, channels={**commands.channels, "speed": 0 * commands.time})
        rng = np.random.default_rng(2)
        real = robot.sampled(robot.drive(turning), 50.0, noise, noise, rng, name="turning")
        drive = Drive("turns", real, robot.sampled(robot.drive(turning)), None, turning)
        with pytest.raises(InconclusiveError, match=r"turning: the robot only turns or stands.*$"):
            DynamicsAxis().measure(evidence([drive, robot.pair(3)]), SETTINGS)


@pytest.mark.parametrize("gain", [1.0, 0.9])
def test_the_gap_is_independent_of_tracker_noise(evidence, gain):
    gaps = []
    for noise in (0.001, 0.008):
        several = [drives(1, gain=gain, noise=noise, turn_noise=noise)[0]]
        several += [
            robot.pair(s, untuned=0.15, gain=gain, noise=noise, turn_noise=noise) for s in (5, 6)
        ]
        gaps.append(judged_gap(DynamicsAxis(), evidence(several))[0])
    assert gaps[1] == pytest.approx(gaps[0], abs=4)
    assert (gaps[0] > 25) == (gain < 1)


def delays(*seconds: float, seed: int = 0) -> list[Drive]:
    return [robot.pair(seed + i, delay=delayed, untuned=0.15) for i, delayed in enumerate(seconds)]


def test_opposite_delays_do_not_cancel(evidence):
    measured = DelayAxis().measure(evidence(delays(0.05, -0.05)), SETTINGS)
    assert measured.value == pytest.approx(1.0, rel=0.05)
    assert measured.details["delay"] == pytest.approx(0.0, abs=2e-3)
    assert measured.details["delay_least"] == pytest.approx(-0.05, abs=2e-3)
    assert measured.details["delay_most"] == pytest.approx(0.05, abs=2e-3)
    assert "delays of both signs" in measured.notes[0]


def test_details_are_json_data_and_fingerprints_are_stable(evidence):
    several: Sequence[Drive] = drives(2)
    for axis in (DynamicsAxis(), DelayAxis()):
        first, second = (axis.measure(evidence(several), SETTINGS) for _ in range(2))
        described = [first.details, dict(first.fingerprint)]
        assert json.loads(json.dumps(described)) == described
        assert first.fingerprint == second.fingerprint
        longer = axis.measure(evidence([*several, *drives(3)[2:]]), SETTINGS)
        assert longer.n > first.n
        assert longer.fingerprint == first.fingerprint
        assert first.bounds(0.9) == second.bounds(0.9)
        assert first.bounds(0.95).is_known


def test_a_mirrored_log_is_reported(evidence):
    (drive,) = drives(1, delay=0.0)
    mirrored = replace(drive, sim=RigidTransform(reflected=True)(drive.sim))
    result = DynamicsAxis().measure(evidence([mirrored]), SETTINGS)
    assert any("mirrored frame" in note for note in result.notes)
    assert result.value > 10 * result.floor
    unchanged = DynamicsAxis().measure(evidence([drive]), SETTINGS)
    assert not any("mirrored" in note for note in unchanged.notes)


@pytest.mark.parametrize("noise", [0.1, 0.3, 0.6])
def test_a_delay_at_the_threshold_rarely_passes(noise):
    rng = np.random.default_rng(3)
    left_out = noise / 199 * stats.norm.ppf((np.arange(200) + 0.5) / 200) * np.sqrt(199)
    ends = []
    for _ in range(2000):
        delay = 1 + noise * rng.standard_normal()
        estimate = time_delay.TimeDelay(delay, delay + left_out, {}, 30.0)
        size = delay_axis.mean_size([estimate])
        assert size.low <= size.value <= size.high
        ends.append((size.low > 1, size.high < 1))
    failed, passed = np.mean(ends, axis=0)
    assert passed < 0.036
    assert failed < 0.036


@pytest.mark.parametrize("true", [0.02, 0.1])
@pytest.mark.parametrize("count", [2, 3])
def test_the_mean_size_of_few_drives_is_no_surer_than_their_noise(count, true):
    rng = np.random.default_rng(1)
    found = []
    for _ in range(400):
        blocks = true + 0.05 * np.sqrt(8) * rng.standard_normal((count, 8))
        left_out = (blocks.sum(axis=1, keepdims=True) - blocks) / 7
        drives = [time_delay.TimeDelay(float(drive.mean()), drive, {}, 10.0) for drive in left_out]
        found.append(delay_axis.mean_size(drives))
    assert np.mean([each.low <= true <= each.high for each in found]) >= 0.93


def test_only_a_delay_within_its_noise_is_shrunk():
    rng = np.random.default_rng(0)
    estimate = delay_axis.denoised_size(np.abs(0.05 + 0.01 * rng.standard_normal(4000)), 0.01)
    assert estimate.mean() == pytest.approx(0.05, rel=0.01)
    assert delay_axis.denoised_size(np.array([0.0, 0.007]), 0.01).tolist() == [0.0, 0.0]
    assert delay_axis.denoised_size(np.array(0.02), 0.0) == 0.02


@pytest.mark.parametrize("period", [0.05, 0.1, 1 / 30, 1 / 60, 0.02, 0.01, 0.0125, 0.008, 0.25])
def test_slightly_different_periods_have_one_fingerprint(period):
    periods = {
        delay_axis.rounded_period(period * (1 + deviation))
        for deviation in (-2e-3, -1e-5, 0.0, 1e-5, 2e-3)
    }
    assert len(periods) == 1
    assert periods.pop() == pytest.approx(period, rel=0.005)
    assert delay_axis.rounded_period(1.03 * period) != delay_axis.rounded_period(period)
