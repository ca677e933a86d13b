"""Windows of all drives on a common time grid, on which the residual network is trained."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from s2rstore.errors import InconclusiveError
from s2rtools.sysid.prediction_error import PredictionError
from s2rtools.sysid.simulators.simulator import LATENCY, Floats, Integers, Replays

STEP = 0.1
"""Time between two corrections, s."""


@dataclass(frozen=True, slots=True)
class Stretches:
    """Windows on a time grid of `STEP`: simulated states (w, k, 5), delayed commands (w, k, c),
    real poses (w, k, 3), and the index of the drive (w,)."""

    states: Floats
    commands: Floats
    poses: Floats
    drive: Integers

    def of(self, chosen: np.ndarray) -> Stretches:
        return Stretches(self.states[chosen], self.commands[chosen], self.poses[chosen],
                         self.drive[chosen])  # fmt: skip


def stretches_of(problem: PredictionError, cube: Floats) -> Stretches:
    """The windows of a problem, simulated with parameters (unit cube).

    Raises InconclusiveError where the logs are too coarse for steps of `STEP`.
    """
    windows, replays = problem.windows, problem.windows.replays
    first = replays.first
    step = float(np.median(np.diff(replays.times[first[0] : first[1]])))
    stride = max(1, round(STEP / step))
    count = (int(np.diff(first).min()) - 1) // stride + 1
    if count < 4 or step > 1.5 * STEP:
        raise InconclusiveError(
            f"--residual: needs at least 4 poses {STEP:g} s apart in every window; the logs have "
            f"one every {step:g} s, so use longer windows or denser logs"
        )
    rows = first[:-1, None] + stride * np.arange(count)
    states = problem.predicted(cube)[rows]
    latency = problem.space.values(cube)[LATENCY]
    return Stretches(states, _commands(replays, rows, latency), windows.poses[rows], replays.drive)


def _commands(replays: Replays, rows: Integers, latency: float) -> Floats:
    """The delayed commands (w, k, channels) at rows (w, k)."""
    commands = np.zeros((*rows.shape, len(replays.values)))
    for number, drive in enumerate(replays.drive):
        low, high = replays.held[drive], replays.held[drive + 1]
        at = replays.times[rows[number]] - latency
        k = np.searchsorted(replays.command_time[low:high], at, side="right") - 1
        values = replays.values[:, low:high][:, np.maximum(k, 0)].T
        commands[number] = np.where(k[:, None] < 0, 0.0, values)
    return commands
