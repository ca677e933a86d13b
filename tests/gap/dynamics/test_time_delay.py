"""Estimation of the time delay between two logs: accuracy and interval coverage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.support import robot
from s2rstore.errors import InconclusiveError, RequestError
from s2rtools.gap.delay import time_delay
from s2rtools.motion_logs import Log
from s2rtools.motion_logs.motion_log import RigidTransform

BASE = robot.commands(20.0, np.random.default_rng(5))
EXACT = robot.drive(BASE)


def rows_of(log: Log, rows: object) -> Log:
    """Some poses of a log."""
    columns = {name: getattr(log, name)[rows] for name in ("time", "x", "y", "heading")}
    return replace(log, **columns)


@given(st.floats(-0.9, 0.9), st.floats(0, 1e9))
def test_any_delay_is_recovered(shift, epoch):
    sim = robot.sampled(EXACT)
    real = replace(sim, time=sim.time + shift + epoch)
    estimate = time_delay.estimate_delay(real, replace(sim, time=sim.time + epoch))
    assert estimate.seconds == pytest.approx(shift, abs=2e-5)
    found = estimate.interval()
    assert found.low - 1e-4 <= shift <= found.high + 1e-4


@settings(max_examples=5)
@given(st.floats(-3, 3), st.floats(-50, 50), st.floats(0.5, 2.0))
def test_the_delay_is_independent_of_frame_and_length_unit(angle, x, scale):
    sim = robot.sampled(EXACT)
    real = RigidTransform(angle, scale=scale, x=x)(robot.sampled(robot.drive(BASE, delay=0.033)))
    assert time_delay.estimate_delay(real, sim).seconds == pytest.approx(0.033, abs=1e-4)


@pytest.mark.parametrize("rates", [(50, 50), (50, 20), (10, 100), (37.3, 50)])
def test_logs_may_have_different_rates(rates):
    delayed = robot.drive(BASE, delay=0.0613)
    real, sim = robot.sampled(delayed, rates[0], start=0.7), robot.sampled(EXACT, rates[1])
    assert time_delay.estimate_delay(real, sim).seconds == pytest.approx(0.0613, abs=2e-3)


def test_wrong_gains_and_partial_drives_do_not_bias_the_delay():
    drive = robot.pair(7, delay=0.04, gain=0.8, turn_gain=1.2, noise=0.0, turn_noise=0.0)
    part = rows_of(drive.real, slice(400, 1000))
    estimate = time_delay.estimate_delay(part, drive.sim)
    assert estimate.seconds == pytest.approx(0.04, abs=5e-4)


def test_estimates_of_noisy_drives_are_accurate_to_a_fraction_of_the_sampling_period():
    errors = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        delay = rng.uniform(-0.1, 0.1)
        commands = robot.commands(30.0, rng)
        real = robot.sampled(robot.drive(commands, delay=0.2 + delay), 50, 0.005, 0.005, rng)
        sim = robot.sampled(robot.drive(commands, delay=0.2))
        errors.append(time_delay.estimate_delay(real, sim).seconds - delay)
    assert np.sqrt(np.mean(np.square(errors))) < 1.5e-3


@pytest.mark.deep
def test_intervals_have_the_nominal_coverage():
    covered = []
    for seed in range(100):
        drive = robot.pair(seed, delay=0.03, noise=0.005, turn_noise=0.005)
        estimate = time_delay.estimate_delay(drive.real, drive.sim)
        covered.append(estimate.interval().low <= 0.03 <= estimate.interval().high)
    assert 0.89 <= np.mean(covered) <= 0.99


def test_logs_without_overlap_are_rejected_in_one_line():
    sim = robot.sampled(EXACT, name="sim.csv")
    for first, last in ((100.0, 120.0), (19.0, 40.0)):
        span = np.linspace(first, last, sim.time.size)
        real = replace(sim, time=span, source="real.csv")
        with pytest.raises(RequestError, match=r"real\.csv .* and sim\.csv .* overlap by.*$"):
            time_delay.estimate_delay(real, sim)


def test_logs_without_usable_motion_are_inconclusive():
    sim = robot.sampled(EXACT, name="sim")
    still = replace(sim, x=sim.x * 0, y=sim.y * 0, heading=sim.heading * 0, source="still")
    with pytest.raises(InconclusiveError, match="still: the motion never changes"):
        time_delay.estimate_delay(still, sim)
    straight = replace(still, x=0.5 * sim.time, source="straight")
    with pytest.raises(InconclusiveError, match="straight: the motion never changes"):
        time_delay.estimate_delay(sim, straight)
    rng = np.random.default_rng(0)
    x, y = 0.01 * rng.standard_normal((2, sim.time.size))
    with pytest.raises(InconclusiveError, match="do not correlate at any time delay"):
        time_delay.estimate_delay(replace(still, x=x, y=y), sim)
    other = robot.sampled(robot.drive(robot.commands(20.0, np.random.default_rng(77))))
    with pytest.raises(InconclusiveError, match=r"do not correlate|end of the search"):
        time_delay.estimate_delay(other, sim)


def test_a_delay_beyond_the_search_range_is_inconclusive():
    sim = robot.sampled(EXACT)
    real = robot.sampled(robot.drive(BASE, delay=0.3))
    with pytest.raises(InconclusiveError, match="end of the search"):
        time_delay.estimate_delay(real, sim, max_delay=0.2)
    estimate = time_delay.estimate_delay(real, sim, max_delay=0.4)
    assert estimate.seconds == pytest.approx(0.3, abs=1e-4)


def test_logs_of_two_poses_or_in_milliseconds_are_rejected():
    sim = robot.sampled(EXACT, name="sim")
    two = replace(rows_of(sim, [0, -1]), source="two")
    with pytest.raises(RequestError, match=r"two: .* too slow to estimate a time delay"):
        time_delay.estimate_delay(two, sim)
    real, sim = (replace(log, time=1000 * log.time) for log in [robot.sampled(EXACT)] * 2)
    with pytest.raises(RequestError, match=r"a pose every 20 s .* are both clocks in seconds"):
        time_delay.estimate_delay(real, sim)


@pytest.mark.parametrize(
    "seconds", [2.05, *(pytest.param(each, marks=pytest.mark.deep) for each in (2.02, 2.1))]
)
def test_a_short_slow_drive_has_an_interval_or_is_inconclusive(seconds):
    messages = set()
    for seed in range(20):
        rng = np.random.default_rng(seed)
        time = np.arange(0, seconds + 1e-9, 0.02)
        speed = 0.3 + time / rng.uniform(3, 20) + 0.02 * np.sin(time)
        logs = [
            Log(time, np.cumsum(speed) * 0.02 + n, 0 * time, 0 * time, "slow", "")
            for n in (0.002 * rng.standard_normal(time.size), 0.0)
        ]
        try:
            estimate = time_delay.estimate_delay(*logs)
            assert np.isfinite(estimate.left_out).all()
        except InconclusiveError as error:
            messages.add(str(error))
    assert any("too short for an interval of the time delay" in line for line in messages)
    assert not any("\n" in line for line in messages)
