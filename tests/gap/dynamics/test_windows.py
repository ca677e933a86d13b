"""Windows restarted from real states, what noise alone would give in them, and their resamples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.support import robot
from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.gap.axis_result import GapSettings
from s2rtools.gap.dynamics import ape_rpe, noise_floor, repeatability
from s2rtools.gap.dynamics.window_bootstrap import Resamples
from s2rtools.gap.dynamics.windows import WindowPlan, windows
from s2rtools.motion_logs import Drive, Log
from s2rtools.motion_logs.rigid_alignment import RigidTransform

PLAN = WindowPlan(horizons=(0.5, 2.0), stride=0.5, scatter=0.0)


def circle(radius: float, speed: float, seconds: float = 10.0) -> Log:
    time = np.arange(0, seconds + 1e-9, 0.01)
    turned = speed / radius * time
    x, y = radius * np.sin(turned), radius * (1 - np.cos(turned))
    return Log(time, x, y, angles.wrap(turned), f"circle of {radius:g} m", "")


def test_errors_of_two_circles_are_the_same_in_every_window() -> None:
    made = windows(circle(1.0, 0.5), circle(2.0, 0.5), PLAN)
    for row, horizon in enumerate(PLAN.horizons):
        a, b = 0.5 * horizon / 1.0, 0.5 * horizon / 2.0
        off = np.hypot(np.sin(a) - 2 * np.sin(b), (1 - np.cos(a)) - 2 * (1 - np.cos(b)))
        known = np.isfinite(made.end[row])
        assert known.sum() == int((10 - horizon) / 0.5) + 1
        assert made.end[row][known] == pytest.approx(off, abs=1e-4)
        assert made.heading[row][known] == pytest.approx(a - b, abs=1e-6)
        assert made.distance[row][known] == pytest.approx(2 * np.sin(a / 2), abs=1e-4)
        assert (made.path[row][known] < made.end[row][known]).all()


def test_windows_are_relative_pose_errors() -> None:
    drive = robot.pair(4, gain=0.9, seconds=10.0)
    made = windows(drive.real, drive.sim, WindowPlan((1.0,), stride=0.02, scatter=0.0))
    real, sim = ape_rpe.resample_pair(drive.real, drive.sim)
    off = ape_rpe.rpe(real, sim, ape_rpe.RpeStep(poses=50))
    n = min(off.position.size, np.isfinite(made.end[0]).sum())
    assert made.end[0][:n] == pytest.approx(off.position[:n], abs=1e-6)
    assert made.heading[0][:n] == pytest.approx(off.heading[:n], abs=1e-6)


def test_neither_frame_matters() -> None:
    drive = robot.pair(4, gain=0.9, seconds=10.0)
    here = windows(drive.real, drive.sim, PLAN)
    there = windows(
        RigidTransform(2.0, x=5.0)(drive.real), RigidTransform(-1.0, y=80.0)(drive.sim), PLAN
    )
    assert np.allclose(here.end, there.end, equal_nan=True, atol=1e-9)
    assert np.nanmax(windows(drive.real, drive.real, PLAN).end) < 1e-12


def test_long_drives_are_cut_in_parts_without_seams() -> None:
    drive = robot.pair(9, gain=0.9, seconds=60.0)
    fine, coarse = (
        windows(drive.real, drive.sim, WindowPlan((0.5,), stride=s, scatter=0.0))
        for s in (0.02, 0.04)
    )
    assert fine.end.shape[1] > 2048
    known = np.isfinite(coarse.end)
    assert known.mean() > 0.99
    assert fine.end[:, ::2][known] == pytest.approx(coarse.end[known])


def test_a_window_that_the_simulator_does_not_cover_is_left_out() -> None:
    drive = robot.pair(4, seconds=10.0)
    early = drive.sim.time < 6.0
    sim = drive.sim
    part = Log(sim.time[early], sim.x[early], sim.y[early], sim.heading[early], "part", "")
    made = windows(drive.real, part, PLAN)
    assert np.isfinite(made.end).tolist() == [
        (made.starts + h <= part.time[-1]).tolist() for h in PLAN.horizons
    ]


def test_no_window_begins_or_ends_in_a_hole() -> None:
    drive = robot.pair(4, seconds=10.0)
    real = drive.real
    kept = (real.time < 3.01) | (real.time > 5.01)
    torn = Log(*(c[kept] for c in (real.time, real.x, real.y, real.heading)), "torn", "")
    made = windows(torn, drive.sim, PLAN)
    whole = windows(real, drive.sim, PLAN)
    for row, horizon in enumerate(PLAN.horizons):
        ends = np.stack([made.starts, made.starts + horizon])
        lost = ((ends > 3.01) & (ends < 5.01)).any(axis=0)
        assert lost.any()
        assert np.isnan(made.end[row][lost]).all()
        assert np.allclose(made.end[row][~lost], whole.end[row][~lost], equal_nan=True, atol=1e-6)


@pytest.mark.parametrize("horizons", [(), (1.0, 0.5), (0.0, 1.0), (-1.0,), (0.001,)])
def test_horizons_that_make_no_sense_are_refused(horizons: tuple[float, ...]) -> None:
    with pytest.raises(RequestError, match="horizon"):
        WindowPlan(horizons=horizons)


def test_noise_is_found_whatever_the_motion() -> None:
    rng = np.random.default_rng(3)
    exact = robot.drive(robot.commands(60.0, rng))
    found = noise_floor.estimate_noise(robot.sampled(exact, 50.0, 0.004, 0.006, rng))
    assert found.position == pytest.approx(0.004 * np.sqrt(2), rel=0.06)
    assert found.heading == pytest.approx(0.006, rel=0.06)
    silent = noise_floor.estimate_noise(robot.sampled(exact))
    assert silent.position < 2e-4
    assert silent.heading < 2e-4


def test_the_floor_is_what_noise_gives_in_these_windows() -> None:
    rng = np.random.default_rng(8)
    exact = robot.drive(robot.commands(40.0, rng))
    late = 0.007
    sim = robot.sampled(exact)
    sim = replace(sim, time=sim.time + late)
    shifted = replace(exact, time=exact.time + late)
    plan = WindowPlan(horizons=(0.5, 2.0), stride=0.5)
    found, expected = [], []
    for _ in range(20):
        real = robot.sampled(shifted, 50.0, 0.004, 0.01, rng)
        made = windows(real, sim, plan)
        found.append(np.nanmean(made.end**2, axis=1))
        expected.append(
            np.nanmean(
                noise_floor.noise_squares(real, made, noise_floor.estimate_noise(real)), axis=1
            )
        )
    assert np.mean(expected, axis=0) == pytest.approx(np.mean(found, axis=0), rel=0.08)


def test_resamples_of_everything_are_the_same_resamples() -> None:
    rng = np.random.default_rng(0)
    values = [rng.random((2, 40)), rng.random((2, 30))]
    values[0][1, 35:] = np.nan
    blocks = Resamples([40, 30], 5, GapSettings(replicates=50))
    mean, draws = blocks.means(values)
    assert mean == pytest.approx(np.nanmean(np.concatenate(values, axis=1), axis=1))
    _, doubled = blocks.means([2 * v for v in values])
    assert doubled == pytest.approx(2 * draws)
    assert draws.shape == (2, 50)
    assert draws.std(axis=1).min() > 0


def test_intervals_of_one_drives_mean_hold() -> None:
    held = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        wave = np.convolve(rng.standard_normal(419), np.ones(20) / 20, mode="valid")[None]
        blocks = Resamples([400], 20, GapSettings(replicates=300, seed=seed))
        mean, draws = blocks.means([wave + 5])
        low, high = np.percentile(blocks.corrected(mean, draws)[0], [2.5, 97.5])
        held += low <= 5 <= high
    assert 0.88 <= held / 200 <= 0.99


@pytest.mark.parametrize("count", [2, 3, 4, 6])
def test_intervals_of_drives_that_differ_hold(count: int) -> None:
    rng = np.random.default_rng(count)
    held = 0
    for seed in range(300):
        each = rng.normal(1.0, 0.3, count)
        blocks = Resamples([20] * count, 5, GapSettings(replicates=300, seed=seed))
        mean, draws = blocks.means([np.full((1, 20), size) for size in each])
        low, high = np.percentile(blocks.corrected(mean, draws)[0], [2.5, 97.5])
        held += low <= 1 <= high
    assert held / 300 >= 0.89


@pytest.mark.parametrize("period", [0.25, 0.125, 0.1])
def test_a_vibration_that_divides_stride_and_horizons_is_seen(period: float) -> None:
    drive = robot.pair(2, noise=0.0, turn_noise=0.0, delay=0.0)
    shaken = replace(drive.sim, y=drive.sim.y + 0.05 * np.sin(2 * np.pi * drive.sim.time / period))
    made = windows(drive.real, shaken)
    seen = np.sqrt(np.nanmean(made.end**2, axis=1))
    assert seen == pytest.approx(0.05, rel=0.2)
    assert np.diff(made.starts).min() > 0


def test_starts_and_lengths_are_scattered_alike_each_time() -> None:
    log = robot.pair(2).real
    plan = WindowPlan()
    assert (plan.starts(log) == plan.starts(log)).all()
    steps = plan.steps(400) / plan.rate
    assert steps.mean(axis=1) == pytest.approx(plan.horizons, rel=0.02)
    assert steps.max() <= plan.longest
    assert (steps.std(axis=1) > 0.1 * np.array(plan.horizons)).all()
    with pytest.raises(RequestError, match=r"scatter 0\.5"):
        WindowPlan(scatter=0.5)


@pytest.mark.parametrize("rate", [50.0, 10.0, 8.0, 4.0])
def test_motion_between_coarse_poses_is_not_noise(rate: float) -> None:
    rng = np.random.default_rng(4)
    exact = robot.drive(robot.commands(60.0, rng))
    assert noise_floor.estimate_noise(robot.sampled(exact, rate)).position < 1e-3
    noisy = noise_floor.estimate_noise(robot.sampled(exact, rate, 0.004, 0.004, rng))
    assert noisy.position < 1.1 * 0.004 * np.sqrt(2)
    assert noisy.heading < 1.1 * 0.004


def test_half_of_real_against_real_is_what_one_real_drive_varies_by() -> None:
    told = robot.commands(60.0, np.random.default_rng(0))
    made = []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        real = robot.sampled(robot.drive(told, slip=0.02, rng=rng), 50, 0.001, 0.001, rng)
        made.append(Drive(f"d{seed}", real, robot.sampled(robot.drive(told)), None, told))
    plan = WindowPlan(horizons=(0.5, 1.0))
    half = np.nanmean(
        repeatability.repeatability_squares(made[0], made[1:], plan, GapSettings(50)), axis=1
    )
    varied = [np.nanmean(windows(d.real, d.sim, plan).end ** 2, axis=1) for d in made]
    assert half == pytest.approx(np.mean(varied, axis=0), rel=0.3)


def test_drives_of_the_same_commands_find_each_other() -> None:
    a, b, c = (robot.pair(seed, seconds=5.0) for seed in (1, 1, 2))
    b = replace(b, real=replace(b.real, sha256="another"))
    assert repeatability.repetitions([a, b, c]) == [[1], [0], []]
    assert repeatability.repetitions([a, a]) == [[], []]
    assert repeatability.repetitions([a, replace(b, commands=None)]) == [[], []]
