"""The two axes: they answer to what they are about, and to nothing else."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from bench.support import robot
from s2rstore.errors import InconclusiveError, RequestError
from s2rtools.gap.axis_result import Anchor, Axis, AxisResult, Evidence, GapSettings
from s2rtools.gap.dynamics import DelayAxis, DynamicsAxis
from s2rtools.gap.dynamics.windows import WindowPlan
from s2rtools.motion_logs import Drive
from s2rtools.motion_logs.rigid_alignment import RigidTransform

SETTINGS = GapSettings(replicates=300)


@pytest.fixture(scope="module")
def evidence(tiny_store: Path):
    """Evidence of the given drives."""
    with s2rstore.open(tiny_store) as store:
        yield lambda drives: Evidence(store, "vanilla", np.arange(3), drives=drives)


def drives(count: int = 1, **real: float) -> list[Drive]:
    return [robot.pair(seed, untuned=0.15, **real) for seed in range(count)]


def gap(measured: AxisResult, anchor: Anchor) -> tuple[float, float, float]:
    """G in percent with its bounds, from paired replicates."""
    value = (measured.value - measured.floor) / (anchor.value - measured.floor)
    spread = (measured.replicates - measured.floor_replicates) / (
        anchor.replicates - measured.floor_replicates
    )
    low, high = np.percentile(100 * spread, [2.5, 97.5])
    return 100 * value, float(low), float(high)


def judged(axis: Axis, evidence: Evidence) -> tuple[float, float, float]:
    return gap(axis.measure(evidence, SETTINGS), axis.anchor(evidence, SETTINGS))


@pytest.mark.parametrize("count", [1, 3])
def test_without_a_gap_both_are_at_their_floors(evidence, count: int) -> None:
    same = evidence(drives(count, delay=0.0))
    for axis in (DynamicsAxis(), DelayAxis()):
        value, low, high = judged(axis, same)
        assert abs(value) < 2
        assert -5 < low <= high < 5


def test_latency_moves_the_delay_and_not_the_dynamics(evidence) -> None:
    late = evidence(drives(2, delay=0.08))
    measured = DelayAxis().measure(late, SETTINGS)
    assert measured.value == pytest.approx(0.08 / robot.PERIOD, rel=0.02)
    assert measured.details["delay"] == pytest.approx(0.08, abs=1e-3)
    assert measured.details["delay_low"] <= 0.0805
    assert measured.details["delay_high"] >= 0.0795
    assert judged(DynamicsAxis(), late)[2] < 3


def test_wrong_motion_moves_the_dynamics_and_not_the_delay(evidence) -> None:
    slow = evidence(drives(2, delay=0.0, gain=0.85, turn_gain=0.9))
    assert judged(DynamicsAxis(), slow)[1] > 15
    assert judged(DelayAxis(), slow)[2] < 3


def test_the_sign_of_the_delay_is_told(evidence) -> None:
    early = DelayAxis().measure(evidence(drives(1, delay=-0.04)), SETTINGS)
    assert early.details["delay"] == pytest.approx(-0.04, abs=1e-3)
    assert early.value == pytest.approx(0.8, rel=0.05)
    assert early.floor == 0


def test_nrmse_of_a_known_error(evidence) -> None:
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


def test_the_scale_is_declared_and_stored(evidence) -> None:
    same = evidence(drives(1, gain=0.9))
    travel, extent = (DynamicsAxis(scale=s).measure(same, SETTINGS) for s in ("travel", "extent"))
    assert travel.fingerprint["scale"] == "travel"
    assert extent.fingerprint["scale"] == "extent"
    assert extent.details["horizons"][0]["scale"] == extent.details["horizons"][1]["scale"]
    assert travel.value != pytest.approx(extent.value)
    with pytest.raises(RequestError, match="scale metres"):
        DynamicsAxis(scale="metres")


def test_repeated_real_drives_are_the_floor(evidence) -> None:
    told = robot.commands(30.0, np.random.default_rng(0))
    sim = robot.sampled(robot.drive(told))
    made = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        real = robot.sampled(robot.drive(told, slip=0.02, rng=rng), 50, 0.001, 0.001, rng)
        later = replace(told, time=told.time + 100 * seed)
        real, other = (replace(log, time=log.time + 100 * seed) for log in (real, sim))
        made.append(Drive(f"d{seed}", real, other, None, later))
    repeated = DynamicsAxis().measure(evidence(made), SETTINGS)
    assert repeated.fingerprint["floor_from"] == "repeated real drives"
    alone = DynamicsAxis().measure(evidence(made[:1]), SETTINGS)
    assert alone.fingerprint["floor_from"] == "noise of the poses"
    floors = [found.details["floor_nrmse"] for found in (repeated, alone)]
    assert floors[0] > 2 * floors[1]
    assert repeated.value < 0.5 * alone.value
    mixed = DynamicsAxis().measure(evidence([*made, robot.pair(9)]), SETTINGS)
    assert mixed.fingerprint["floor_from"] == "mixed"


def test_rows_of_measure_floor_and_anchor_are_one_resample(evidence) -> None:
    some = evidence(drives(3, gain=0.9))
    measured = DynamicsAxis().measure(some, SETTINGS)
    same = [replace(d, untuned=d.sim) for d in some.drives]
    anchor = DynamicsAxis().anchor(evidence(same), SETTINGS)
    assert anchor.value == pytest.approx(measured.value)
    assert anchor.replicates == pytest.approx(measured.replicates)
    assert measured.replicates.shape == measured.floor_replicates.shape == (300,)


def test_the_bad_state_of_the_delay_is_a_period_or_the_untuned_simulator(evidence) -> None:
    some = evidence(drives(1))
    assert DelayAxis(bad_state="untuned").anchor(some, SETTINGS).value > 3
    whole = DelayAxis().anchor(some, SETTINGS)
    assert whole.value == 1.0
    assert whole.replicates.tolist() == [1.0] * 300


def test_what_is_missing_is_said(evidence) -> None:
    none = evidence([])
    assert "no drives" in (DynamicsAxis().missing(none) or "")
    assert "no drives" in (DelayAxis().missing(none) or "")
    quiet = evidence([replace(robot.pair(1), commands=None)])
    assert DynamicsAxis().missing(quiet) is None
    assert "commands.csv" in (DelayAxis().missing(quiet) or "")
    assert DelayAxis(period=0.1).missing(quiet) is None
    assert DelayAxis(period=0.1).measure(quiet, SETTINGS).value == pytest.approx(0.3, rel=0.1)
    for axis in (DynamicsAxis(), DelayAxis(bad_state="untuned")):
        with pytest.raises(RequestError, match=r"drive drive1 has no untuned\.\*"):
            axis.anchor(evidence([robot.pair(1)]), SETTINGS)


def test_unequal_periods_and_short_drives_are_refused(evidence) -> None:
    a, b = drives(2)
    assert b.commands is not None
    other = replace(b, commands=replace(b.commands, period=0.1))
    with pytest.raises(RequestError, match=r"0\.05 s in drive drive0, 0\.1 s in drive1"):
        DelayAxis().measure(evidence([a, other]), SETTINGS)
    short = evidence([robot.pair(1, seconds=5.0)])
    with pytest.raises(InconclusiveError, match=r"windows of 5 s in the drives, 8 are needed"):
        DynamicsAxis().measure(short, SETTINGS)


def poses(drive: Drive, rate: float, side: str) -> Drive:
    """The drive with one log thinned to `rate` Hz."""
    log = getattr(drive, side)
    some = slice(None, None, round(50 / rate))
    thin = replace(
        log, time=log.time[some], x=log.x[some], y=log.y[some], heading=log.heading[some]
    )
    return replace(drive, **{side: thin})


@pytest.mark.parametrize("side", ["real", "sim"])
def test_poses_too_coarse_for_the_windows_are_inconclusive(evidence, side: str) -> None:
    drive = robot.pair(1, seconds=60.0, gain=0.9)
    coarse = evidence([poses(drive, 1.0, side)])
    with pytest.raises(InconclusiveError, match=r"poses every 1 s are too coarse .* record one"):
        DynamicsAxis().measure(coarse, SETTINGS)
    assert DynamicsAxis().measure(evidence([poses(drive, 10.0, side)]), SETTINGS).value > 0.05


def test_motion_that_looks_like_noise_is_inconclusive(evidence) -> None:
    drive = robot.pair(1, seconds=60.0, gain=0.9, noise=0.0, turn_noise=0.0)
    slow = evidence([poses(drive, 1.0, "real")])
    with pytest.raises(InconclusiveError, match="noise cannot be separated from motion"):
        DynamicsAxis(WindowPlan(horizons=(4.0, 8.0))).measure(slow, SETTINGS)


def test_a_robot_that_turns_in_place_is_inconclusive(evidence) -> None:
    for noise in (0.0, 0.002):
        told = robot.commands(20.0, np.random.default_rng(1))
        turning = replace(told, channels={**told.channels, "speed": 0 * told.time})
        rng = np.random.default_rng(2)
        real = robot.sampled(robot.drive(turning), 50.0, noise, noise, rng, name="turning")
        only = Drive("turns", real, robot.sampled(robot.drive(turning)), None, turning)
        with pytest.raises(
            InconclusiveError, match="turning: the robot only turns or stands"
        ) as error:
            DynamicsAxis().measure(evidence([only, robot.pair(3)]), SETTINGS)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("gain", [1.0, 0.9])
def test_a_noisier_tracker_changes_no_gap(evidence, gain: float) -> None:
    found = []
    for noise in (0.001, 0.008):
        some = [drives(1, gain=gain, noise=noise, turn_noise=noise)[0]]
        some += [
            robot.pair(s, untuned=0.15, gain=gain, noise=noise, turn_noise=noise) for s in (5, 6)
        ]
        found.append(judged(DynamicsAxis(), evidence(some))[0])
    assert found[1] == pytest.approx(found[0], abs=4)
    assert (found[0] > 25) == (gain < 1)


@pytest.mark.parametrize("rate", [4.0, 12.0])
def test_a_simulator_that_shakes_is_a_gap(evidence, rate: float) -> None:
    drive = robot.pair(1, untuned=0.15)
    shake = 0.05 * np.sin(2 * np.pi * rate * drive.sim.time)
    shaken = replace(drive, sim=replace(drive.sim, y=drive.sim.y + shake))
    assert judged(DynamicsAxis(), evidence([shaken]))[1] > 15


def delays(*seconds: float, seed: int = 0) -> list[Drive]:
    return [robot.pair(seed + i, delay=late, untuned=0.15) for i, late in enumerate(seconds)]


def test_opposite_delays_do_not_cancel(evidence) -> None:
    measured = DelayAxis().measure(evidence(delays(0.05, -0.05)), SETTINGS)
    assert measured.value == pytest.approx(1.0, rel=0.05)
    assert measured.details["delay"] == pytest.approx(0.0, abs=2e-3)
    assert measured.details["delay_least"] == pytest.approx(-0.05, abs=2e-3)
    assert measured.details["delay_most"] == pytest.approx(0.05, abs=2e-3)
    assert "delays of both signs" in measured.notes[0]


def test_rows_of_both_axes_are_the_same_drives(evidence) -> None:
    both = GapSettings(replicates=400, seed=5)
    uneven = [
        robot.pair(0, delay=0.0), robot.pair(1, delay=0.0), robot.pair(2, delay=0.1, gain=0.8)
    ]  # fmt: skip
    rows = [
        axis.measure(evidence(uneven), both).replicates for axis in (DynamicsAxis(), DelayAxis())
    ]
    assert np.corrcoef(rows)[0, 1] > 0.7


def plain(value: object) -> bool:
    return json.loads(json.dumps(value)) == value


def test_details_are_plain_data_and_fingerprints_agree_with_themselves(evidence) -> None:
    some: Sequence[Drive] = drives(2)
    for axis in (DynamicsAxis(), DelayAxis()):
        first, second = (axis.measure(evidence(some), SETTINGS) for _ in range(2))
        assert plain(first.details)
        assert plain(dict(first.fingerprint))
        assert first.fingerprint == second.fingerprint
        longer = axis.measure(evidence([*some, *drives(3)[2:]]), SETTINGS)
        assert longer.n > first.n
        assert longer.fingerprint == first.fingerprint
        assert (first.replicates == second.replicates).all()
        assert np.isfinite(first.replicates).all()


def test_a_mirrored_log_is_told(evidence) -> None:
    (drive,) = drives(1, delay=0.0)
    mirrored = replace(drive, sim=RigidTransform(reflected=True)(drive.sim))
    told = DynamicsAxis().measure(evidence([mirrored]), SETTINGS)
    assert any("mirrored frame" in note for note in told.notes)
    assert told.value > 10 * told.floor
    assert not any(
        "mirrored" in n for n in DynamicsAxis().measure(evidence([drive]), SETTINGS).notes
    )
