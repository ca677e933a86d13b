"""Cut recorded drives into windows and estimate the state at the start of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from s2rstore.errors import InconclusiveError, RequestError
from s2rtools.gap.dynamics import noise_floor as noise
from s2rtools.motion_logs import Commands, Drive
from s2rtools.sysid.simulators.simulator import Floats, Integers, Replays, Simulator, pack

_SMOOTHED = 0.15
"""Time on both sides of a window's start within which its speeds are fitted, s."""
_MIN_POSES = 8
"""Fewest poses of a window."""
_MIN_NOISE = np.array([1e-5, 1e-5, 1e-5])


@dataclass(frozen=True, slots=True)
class SysidWindows:
    """Windows of all drives: `poses` (n, 3) are x, y and unwrapped heading at `replays.times`;
    `starts` (w, 5) are states estimated from the poses around each window's start; `noise` (3,) is
    the white noise of the poses, m, m, rad; `drives` are the names by number.
    """

    drives: tuple[str, ...]
    replays: Replays
    poses: Floats
    starts: Floats
    noise: Floats

    def __len__(self) -> int:
        return len(self.starts)

    @property
    def drive_of_row(self) -> Integers:
        return np.repeat(self.replays.drive, np.diff(self.replays.first))

    @property
    def window_of_row(self) -> Integers:
        return np.repeat(np.arange(len(self)), np.diff(self.replays.first))

    def seconds(self) -> float:
        first = self.replays.first
        return float((self.replays.times[first[1:] - 1] - self.replays.times[first[:-1]]).sum())

    def only(self, windows: Integers) -> SysidWindows:
        """A selection of the windows, in this order, with the commands of all drives."""
        first = self.replays.first
        rows = np.concatenate([np.arange(first[i], first[i + 1]) for i in windows])
        replays = Replays(
            self.replays.times[rows],
            np.cumsum([0, *(first[i + 1] - first[i] for i in windows)]),
            self.replays.drive[windows],
            self.replays.command_time, self.replays.values, self.replays.held,
        )  # fmt: skip
        return SysidWindows(
            self.drives, replays, self.poses[rows], self.starts[windows], self.noise
        )


def cut_windows(drives: Sequence[Drive], simulator: Simulator, seconds: float) -> SysidWindows:
    """Cut the real logs into windows of `seconds` without overlap, where commands are known.

    Commands before the first count as 0. Raises RequestError where a drive has no usable commands,
    InconclusiveError where it has no whole window.
    """
    commands_of = [_commands(drive, simulator) for drive in drives]
    replays: list[tuple[int, Floats]] = []
    poses: list[Floats] = []
    starts: list[Floats] = []
    for number, (drive, commands) in enumerate(zip(drives, commands_of, strict=True)):
        real = drive.real
        whole = np.stack([real.x, real.y, np.unwrap(real.heading)], axis=1)
        for a, b in _ranges(drive, commands, seconds):
            replays.append((number, real.time[a:b]))
            poses.append(whole[a:b])
            starts.append(state_at(real.time, whole, a))
    noises = [noise.estimate_noise(drive.real) for drive in drives]
    deviations = [(n.position / np.sqrt(2), n.position / np.sqrt(2), n.heading) for n in noises]
    pooled = np.sqrt(np.mean(np.square(deviations), axis=0))
    names = tuple(drive.name for drive in drives)
    channels = simulator.channels(commands_of[0])
    return SysidWindows(names, pack(commands_of, replays, channels), np.concatenate(poses),
                        np.stack(starts), np.maximum(pooled, _MIN_NOISE))  # fmt: skip


def _commands(drive: Drive, simulator: Simulator) -> Commands:
    if drive.commands is None:
        raise RequestError(f"{drive.name}: no commands.csv; identification needs the commands")
    try:
        simulator.channels(drive.commands)
    except KeyError:
        required = " or ".join(", ".join(names) for names in (simulator.torques, simulator.efforts))
        has = ", ".join(drive.commands.channels)
        raise RequestError(
            f"{drive.commands.source}: needs channels {required} (has: {has})"
        ) from None
    return drive.commands


def _ranges(drive: Drive, commands: Commands, seconds: float) -> list[tuple[int, int]]:
    time = drive.real.time
    begin, end = commands.time[0], commands.time[-1] + commands.period
    ranges = []
    a = int(np.searchsorted(time, begin))
    while a < len(time) and time[a] + seconds <= end + 1e-9:
        b = int(np.searchsorted(time, time[a] + seconds + 1e-9))
        if b >= len(time) and time[-1] < time[a] + seconds - 1.5 * (time[-1] - time[-2]):
            break
        if b - a >= _MIN_POSES:
            ranges.append((a, b))
        a = max(b, a + 1)
    if not ranges:
        raise InconclusiveError(
            f"{drive.name}: no window of {seconds:g} s with {_MIN_POSES} poses and commands (poses "
            f"from {time[0]:.6g} to {time[-1]:.6g} s, commands from {begin:.6g} to {end:.6g} s); "
            "use one clock, give a longer log or a shorter --window"
        )
    return ranges


def state_at(time: Floats, poses: Floats, i: int) -> Floats:
    """x, y, heading, speed and turn rate at sample i, from a parabola fitted to nearby poses."""
    near = np.flatnonzero(np.abs(time - time[i]) <= _SMOOTHED)
    if len(near) < 5:
        near = np.arange(max(0, i - 2), min(len(time), i + 3))
    degree = 2 if len(near) >= 4 else 1
    powers = np.vander(time[near] - time[i], degree + 1, increasing=True)
    fit = np.linalg.lstsq(powers, poses[near], rcond=None)[0]
    x, y, heading = fit[0]
    speed = fit[1, 0] * np.cos(heading) + fit[1, 1] * np.sin(heading)
    return np.array([x, y, heading, speed, fit[1, 2]])
