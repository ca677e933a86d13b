"""A simulated differential-drive robot: random commands, first-order motors, exact poses."""

from __future__ import annotations

import hashlib

import numpy as np
from scipy import signal

from s2rstore.geometry import angles
from s2rtools.motion_logs import Commands, Drive, Log

STEP = 0.001
PERIOD = 0.05


def commands(seconds: float, rng: np.random.Generator, hold: float = 1.0) -> Commands:
    """Random speeds (m/s) and turn rates (rad/s), each held for about `hold` seconds."""
    n = round(seconds / PERIOD)
    code = np.cumsum(rng.random(n) < PERIOD / hold)
    speed = rng.uniform(0.1, 0.8, n)[code]
    turn = rng.uniform(-0.9, 0.9, n)[code]
    time = np.arange(n) * PERIOD
    channels = {"speed": speed, "turn": turn}
    digest = hashlib.sha256(np.stack([time, speed, turn]).tobytes()).hexdigest()
    return Commands(time, channels, PERIOD, "random commands", digest)


def drive(
    commands_sent: Commands,
    delay: float = 0.0,
    lag: float = 0.15,
    gain: float = 1.0,
    turn_gain: float = 1.0,
    slip: float = 0.0,
    rng: np.random.Generator | None = None,
) -> Log:
    """The exact motion at 1 kHz, `delay` s late: motors follow with the time constant `lag`.

    `slip` (1/sqrt(s)) disturbs speed and turn rate by white noise.
    """
    end = commands_sent.time[-1] + commands_sent.period
    time = np.arange(0.0, end, STEP)
    at = np.searchsorted(commands_sent.time, time, side="right") - 1
    rates = np.zeros((2, time.size))
    for row, (name, factor) in enumerate((("speed", gain), ("turn", turn_gain))):
        target = commands_sent.channels[name][at] * factor
        keep = np.exp(-STEP / lag)
        rates[row] = signal.lfilter([1 - keep], [1, -keep], target)
    if slip:
        assert rng is not None
        rates += slip / np.sqrt(STEP) * rng.standard_normal(rates.shape)
    heading = np.cumsum(rates[1]) * STEP
    x, y = (np.cumsum(rates[0] * f(heading)) * STEP for f in (np.cos, np.sin))
    return Log(time + delay, x, y, heading, "paper", "0")


def sampled(
    exact: Log,
    rate: float = 50.0,
    noise: float = 0.0,
    turn_noise: float = 0.0,
    rng: np.random.Generator | None = None,
    start: float = 0.0,
    name: str = "log",
) -> Log:
    """What a sensor of `rate` Hz records, with white noise in m and rad."""
    time = np.arange(start, exact.time[-1], 1.0 / rate)
    x, y, heading = (np.interp(time, exact.time, c) for c in (exact.x, exact.y, exact.heading))
    if noise or turn_noise:
        assert rng is not None
        x = x + noise * rng.standard_normal(time.size)
        y = y + noise * rng.standard_normal(time.size)
        heading = heading + turn_noise * rng.standard_normal(time.size)
    heading = angles.wrap(heading)
    content = hashlib.sha256(np.stack([time, x, y, heading]).tobytes()).hexdigest()
    return Log(time, x, y, heading, name, content)


def pair(
    seed: int,
    delay: float = 0.03,
    seconds: float = 30.0,
    noise: float = 0.002,
    turn_noise: float = 0.003,
    untuned: float | None = None,
    **real: float,
) -> Drive:
    """One drive: the simulator is exact but for the delay and what `real` says of the robot."""
    rng = np.random.default_rng(seed)
    sent = commands(seconds, rng)
    truth = drive(sent, delay=delay, rng=rng, **real)
    recorded = sampled(truth, 50.0, noise, turn_noise, rng, name=f"real{seed}")
    sim = sampled(drive(sent), 50.0, name=f"sim{seed}")
    bad = None
    if untuned is not None:
        bad = sampled(drive(sent, delay=untuned, lag=0.4, gain=1.2), 50.0, name=f"untuned{seed}")
    return Drive(f"drive{seed}", recorded, sim, bad, sent)
