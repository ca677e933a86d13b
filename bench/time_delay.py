"""Time delay between two logs at 50 Hz against the peak of their cross-correlation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import signal

from bench.budget import BudgetRow
from bench.support import robot
from s2rtools.gap.delay import time_delay
from s2rtools.motion_logs import Log

SEEDS = 100
RATE = 50.0
NOISE = ((0.001, 0.002), (0.005, 0.005), (0.01, 0.01), (0.02, 0.02))
"""Noise of positions in m and of headings in rad."""
BUDGET = 2.7


def figures(seeds: int = SEEDS) -> Iterator[BudgetRow]:
    """Root mean square errors over random commands of 30 s and delays within 0.15 s."""
    for noise, turn_noise in NOISE:
        ours, theirs, held = [], [], []
        for seed in range(seeds):
            late, real, sim = _pair(seed, noise, turn_noise)
            estimate = time_delay.estimate_delay(real, sim)
            ours.append(estimate.seconds - late)
            bounds = estimate.interval()
            held.append(bounds.low <= late <= bounds.high)
            theirs.append(cross_correlation(real, sim) - late)
        name = f"delay, noise {1000 * noise:g} mm {1000 * turn_noise:g} mrad"
        yield BudgetRow(f"{name}: cross-correlation", _rms(theirs), "ms")
        yield BudgetRow(name, _rms(ours), "ms", BUDGET)
        yield BudgetRow(
            f"{name}: intervals that hold", float(np.mean(held)), "share", 0.9, "at least"
        )


def cross_correlation(real: Log, sim: Log) -> float:
    """The lag, s, of the peak of the summed cross-correlations of speed and yaw rate."""
    time = np.arange(max(real.time[0], sim.time[0]), min(real.time[-1], sim.time[-1]), 1 / RATE)
    a, b = (_rates(log, time) for log in (real, sim))
    total = sum(signal.correlate(p, q) / (p.std() * q.std()) for p, q in zip(a, b, strict=True))
    lags = signal.correlation_lags(a[0].size, b[0].size)
    near = np.abs(lags) <= RATE
    return float(lags[near][np.argmax(np.asarray(total)[near])] / RATE)


def _rates(log: Log, time: np.ndarray) -> list[np.ndarray]:
    """Speed and yaw rate about their means, smoothed as in the time delay estimate."""
    columns = (log.x, log.y, np.unwrap(log.heading))
    sigma = time_delay.SMOOTHING * RATE
    kernel = signal.windows.gaussian(int(6 * sigma) | 1, sigma)
    x, y, heading = (
        np.gradient(np.convolve(np.interp(time, log.time, c), kernel / kernel.sum(), "same"))
        for c in columns
    )
    edge = kernel.size
    return [(c - c[edge:-edge].mean())[edge:-edge] for c in (np.hypot(x, y), heading)]


def _pair(seed: int, noise: float, turn_noise: float) -> tuple[float, Log, Log]:
    rng = np.random.default_rng(seed)
    late = rng.uniform(-0.15, 0.15)
    commands = robot.commands(30.0, rng)
    exact = robot.drive(commands, delay=0.2 + late)
    real = robot.sampled(exact, RATE, noise, turn_noise, rng, name="real")
    return late, real, robot.sampled(robot.drive(commands, delay=0.2), RATE, name="sim")


def _rms(errors: list[float]) -> float:
    return float(1000 * np.sqrt(np.mean(np.square(errors))))
