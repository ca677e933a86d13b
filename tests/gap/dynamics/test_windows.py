"""Restarted windows, their noise floor and their resamples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.support import robot
from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.gap.dynamics import noise_floor
from s2rtools.gap.dynamics.windows import WindowPlan, WindowUnits, windows
from s2rtools.motion_logs import Drive, Log
from s2rtools.motion_logs.motion_log import RigidTransform

PLAN = WindowPlan(horizons=(0.5, 2.0), stride=0.5, scatter=0.0)


def circle(radius: float, speed: float, seconds: float = 10.0) -> Log:
    time = np.arange(0, seconds + 1e-9, 0.01)
    turned = speed / radius * time
    x, y = radius * np.sin(turned), radius * (1 - np.cos(turned))
    return Log(time, x, y, angles.wrap(turned), f"circle of {radius:g} m", "")


def test_errors_of_two_circles_equal_the_closed_form():
    result = windows(circle(1.0, 0.5), circle(2.0, 0.5), PLAN)
    for row, horizon in enumerate(PLAN.horizons):
        a, b = 0.5 * horizon / 1.0, 0.5 * horizon / 2.0
        expected = np.hypot(np.sin(a) - 2 * np.sin(b), (1 - np.cos(a)) - 2 * (1 - np.cos(b)))
        is_known = np.isfinite(result.end[row])
        assert is_known.sum() == int((10 - horizon) / 0.5) + 1
        assert result.end[row][is_known] == pytest.approx(expected, abs=1e-4)
        assert result.heading[row][is_known] == pytest.approx(a - b, abs=1e-6)
        assert result.distance[row][is_known] == pytest.approx(2 * np.sin(a / 2), abs=1e-4)
        assert (result.path[row][is_known] < result.end[row][is_known]).all()


def test_window_errors_are_independent_of_the_frames():
    drive = robot.pair(4, gain=0.9, seconds=10.0)
    original = windows(drive.real, drive.sim, PLAN)
    transformed = windows(
        RigidTransform(2.0, x=5.0)(drive.real), RigidTransform(-1.0, y=80.0)(drive.sim), PLAN
    )
    assert np.allclose(original.end, transformed.end, equal_nan=True, atol=1e-9)
    assert np.nanmax(windows(drive.real, drive.real, PLAN).end) < 1e-12


def test_long_drives_are_processed_in_parts_without_seams():
    drive = robot.pair(9, gain=0.9, seconds=60.0)
    fine, coarse = (
        windows(drive.real, drive.sim, WindowPlan((0.5,), stride=s, scatter=0.0))
        for s in (0.02, 0.04)
    )
    assert fine.end.shape[1] > 2048
    is_known = np.isfinite(coarse.end)
    assert is_known.mean() > 0.99
    assert fine.end[:, ::2][is_known] == pytest.approx(coarse.end[is_known])


def test_windows_beyond_the_simulation_are_excluded():
    drive = robot.pair(4, seconds=10.0)
    early = drive.sim.time < 6.0
    sim = drive.sim
    part = Log(sim.time[early], sim.x[early], sim.y[early], sim.heading[early], "part", "")
    result = windows(drive.real, part, PLAN)
    assert np.isfinite(result.end).tolist() == [
        (result.starts + h <= part.time[-1]).tolist() for h in PLAN.horizons
    ]


def test_windows_that_touch_a_hole_are_excluded():
    drive = robot.pair(4, seconds=10.0)
    real = drive.real
    rows = (real.time < 3.01) | (real.time > 5.01)
    with_hole = Log(*(c[rows] for c in (real.time, real.x, real.y, real.heading)), "torn", "")
    result = windows(with_hole, drive.sim, PLAN)
    complete = windows(real, drive.sim, PLAN)
    for row, horizon in enumerate(PLAN.horizons):
        ends = np.stack([result.starts, result.starts + horizon])
        in_hole = ((ends > 3.01) & (ends < 5.01)).any(axis=0)
        assert in_hole.any()
        assert np.isnan(result.end[row][in_hole]).all()
        assert np.allclose(
            result.end[row][~in_hole], complete.end[row][~in_hole], equal_nan=True, atol=1e-6
        )


@pytest.mark.parametrize("horizons", [(), (1.0, 0.5), (0.0, 1.0), (-1.0,), (0.001,)])
def test_invalid_horizons_are_rejected(horizons):
    with pytest.raises(RequestError, match="horizon"):
        WindowPlan(horizons=horizons)


def test_noise_is_estimated_independently_of_the_motion():
    rng = np.random.default_rng(3)
    exact = robot.drive(robot.commands(60.0, rng))
    estimate = noise_floor.estimate_noise(robot.sampled(exact, 50.0, 0.004, 0.006, rng))
    assert estimate.position == pytest.approx(0.004 * np.sqrt(2), rel=0.06)
    assert estimate.heading == pytest.approx(0.006, rel=0.06)
    noise_free = noise_floor.estimate_noise(robot.sampled(exact))
    assert noise_free.position < 2e-4
    assert noise_free.heading < 2e-4


def test_the_noise_floor_equals_the_errors_caused_by_noise():
    rng = np.random.default_rng(8)
    exact = robot.drive(robot.commands(40.0, rng))
    delay = 0.007
    sim = robot.sampled(exact)
    sim = replace(sim, time=sim.time + delay)
    shifted = replace(exact, time=exact.time + delay)
    plan = WindowPlan(horizons=(0.5, 2.0), stride=0.5)
    squares, expected = [], []
    for _ in range(20):
        real = robot.sampled(shifted, 50.0, 0.004, 0.01, rng)
        result = windows(real, sim, plan)
        noise = noise_floor.noise_squares(real, result, noise_floor.estimate_noise(real))
        squares.append(np.nanmean(result.end**2, axis=1))
        expected.append(np.nanmean(noise, axis=1))
    assert np.mean(expected, axis=0) == pytest.approx(np.mean(squares, axis=0), rel=0.08)


def test_means_are_over_all_windows_and_without_each_drive():
    rng = np.random.default_rng(0)
    values = [rng.random((2, 40)), rng.random((2, 30))]
    values[0][1, 35:] = np.nan
    mean, left_out = WindowUnits([40, 30], 5).means(values)
    assert mean == pytest.approx(np.nanmean(np.concatenate(values, axis=1), axis=1))
    assert pytest.approx(np.array([np.nanmean(v, axis=1) for v in values[::-1]])) == left_out.T


@pytest.mark.deep
def test_intervals_of_one_drive_have_the_nominal_coverage():
    covered = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        wave = np.convolve(rng.standard_normal(419), np.ones(20) / 20, mode="valid")[None]
        units = WindowUnits([400], 20)
        mean, left_out = units.means([wave + 5])
        found = units.interval(mean[0], left_out[0], 0.95)
        covered += found.low <= 5 <= found.high
    assert 0.88 <= covered / 200 <= 0.99


@pytest.mark.parametrize(
    "count", [3, *(pytest.param(count, marks=pytest.mark.deep) for count in (4, 6))]
)
def test_intervals_of_different_drives_have_the_nominal_coverage(count):
    rng = np.random.default_rng(count)
    covered = 0
    for _ in range(300):
        levels = rng.normal(1.0, 0.3, count)
        units = WindowUnits([20] * count, 5)
        mean, left_out = units.means([np.full((1, 20), size) for size in levels])
        found = units.interval(mean[0], left_out[0], 0.95)
        covered += found.low <= 1 <= found.high
    assert covered / 300 >= 0.89


@pytest.mark.parametrize("period", [0.25, 0.1])
def test_a_vibration_that_divides_stride_and_horizons_is_detected(period):
    drive = robot.pair(2, noise=0.0, turn_noise=0.0, delay=0.0)
    vibration = 0.05 * np.sin(2 * np.pi * drive.sim.time / period)
    result = windows(drive.real, replace(drive.sim, y=drive.sim.y + vibration))
    rms = np.sqrt(np.nanmean(result.end**2, axis=1))
    assert rms == pytest.approx(0.05, rel=0.2)
    assert np.diff(result.starts).min() > 0


@pytest.mark.parametrize("rate", [50.0, 4.0])
def test_motion_between_coarse_poses_is_not_counted_as_noise(rate):
    rng = np.random.default_rng(4)
    exact = robot.drive(robot.commands(60.0, rng))
    assert noise_floor.estimate_noise(robot.sampled(exact, rate)).position < 1e-3
    noisy = noise_floor.estimate_noise(robot.sampled(exact, rate, 0.004, 0.004, rng))
    assert noisy.position < 1.1 * 0.004 * np.sqrt(2)
    assert noisy.heading < 1.1 * 0.004


def test_repeatability_equals_the_variation_of_one_real_drive():
    commands = robot.commands(60.0, np.random.default_rng(0))
    drives = []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        real = robot.sampled(robot.drive(commands, slip=0.02, rng=rng), 50, 0.001, 0.001, rng)
        drives.append(Drive(f"d{seed}", real, robot.sampled(robot.drive(commands)), None, commands))
    plan = WindowPlan(horizons=(0.5, 1.0))
    half = noise_floor.repeatability_squares(drives[0], drives[1:], plan, 1.0)
    variations = [np.nanmean(windows(d.real, d.sim, plan).end ** 2, axis=1) for d in drives]
    assert np.nanmean(half, axis=1) == pytest.approx(np.mean(variations, axis=0), rel=0.3)


def test_drives_with_equal_commands_are_repetitions():
    a, b, c = (robot.pair(seed, seconds=5.0) for seed in (1, 1, 2))
    b = replace(b, real=replace(b.real, sha256="another"))
    assert noise_floor.repetitions([a, b, c]) == [[1], [0], []]
    assert noise_floor.repetitions([a, a]) == [[], []]
    assert noise_floor.repetitions([a, replace(b, commands=None)]) == [[], []]
