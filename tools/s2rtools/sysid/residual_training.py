"""What the identified simulator still leaves, learned by a small network; kept only if it helps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from s2rstore.errors import InconclusiveError
from s2rtools.sysid.heldout_error import HeldOut, compared
from s2rtools.sysid.identify import Identification
from s2rtools.sysid.prediction_error import PredictionError
from s2rtools.sysid.simulators.simulator import LATENCY, Floats, Integers, Replays

if TYPE_CHECKING:
    from s2rtools.precompute.pipeline import ProgressReporter

STEP = 0.1
"""Seconds between two corrections."""
LEAST_JUDGING = 2
"""Held-out drives, for a network to be kept."""


@dataclass(frozen=True, slots=True)
class Residual:
    """`weights` are the bytes of a safetensors file; `error` compares the simulator with and
    without the network on held-out windows."""

    error: HeldOut
    weights: bytes

    @property
    def accepted(self) -> bool:
        """Better on drives that the network never saw, of which one is none to judge by."""
        return self.error.helps and self.error.drives >= LEAST_JUDGING

    @property
    def sentence(self) -> str:
        error = self.error
        verdict = "helps" if self.accepted else "did not help and is not kept"
        if error.drives < LEAST_JUDGING:
            verdict = f"not kept, for it takes {LEAST_JUDGING} held-out drives to judge it"
        turn = 57.29578 * error.untuned[1], 57.29578 * error.fitted[1]
        without, with_it = 100 * error.untuned[0], 100 * error.fitted[0]
        low, high = 100 * error.low, 100 * error.high
        return (
            f"residual network: {verdict}; held-out windows {without:.2f} cm without and "
            f"{with_it:.2f} cm with it, better by {100 * error.improvement:.2f} cm "
            f"({low:.2f} .. {high:.2f}); headings {turn[0]:.2f} and {turn[1]:.2f} degrees"
        )

    def record(self) -> dict[str, Any]:
        told = self.error.record()
        return {
            "accepted": self.accepted, "sentence": self.sentence, "drives": told["drives"],
            "windows": told["windows"],
            "without": told["untuned"], "with": told["fitted"],
            "improvement_m": told["improvement_m"], "improvement_low": told["improvement_low"],
            "improvement_high": told["improvement_high"],
        }  # fmt: skip


@dataclass(frozen=True, slots=True)
class Stretches:
    """Windows on one grid of `STEP`: simulated states (w, k, 5), delayed commands (w, k, c), real
    poses (w, k, 3), and the drive of each (w,)."""

    states: Floats
    commands: Floats
    poses: Floats
    drive: Integers

    def of(self, chosen: np.ndarray) -> Stretches:
        return Stretches(self.states[chosen], self.commands[chosen], self.poses[chosen],
                         self.drive[chosen])  # fmt: skip


def learn(found: Identification, reporter: ProgressReporter, epochs: int = 200) -> Residual:
    """Train on fitted drives, a quarter of them kept for stopping; judge on held-out drives.

    Raises InconclusiveError where the logs are too coarse for steps of `STEP`.
    """
    from s2rtools.sysid.residual_network import ResidualNetwork, train

    stretches = _stretches(found.everything, found.cube)
    fitted = len(found.fitted)
    kept = max(1, fitted // 4)
    training = stretches.of(stretches.drive < fitted - kept)
    stopping = stretches.of((stretches.drive >= fitted - kept) & (stretches.drive < fitted))
    judged = stretches.of(stretches.drive >= fitted)
    correction = ResidualNetwork(training, found.settings.seed)
    train(correction, training, stopping, epochs, reporter)
    with_it, without = correction.poses(judged), judged.states[:, :, :3]
    rng = np.random.default_rng((found.settings.seed, 20_000))
    error = compared(_errors(without, judged.poses), _errors(with_it, judged.poses),
                     judged.drive, found.settings.replicates, rng)  # fmt: skip
    return Residual(error, correction.saved(found.values))


def _errors(poses: Floats, real: Floats) -> Floats:
    off = poses - real
    place = np.sqrt((off[:, 1:, 0] ** 2 + off[:, 1:, 1] ** 2).mean(axis=1))
    return np.stack([place, np.sqrt((off[:, 1:, 2] ** 2).mean(axis=1))], axis=1)


def _stretches(problem: PredictionError, cube: Floats) -> Stretches:
    windows, replays = problem.windows, problem.windows.replays
    first = replays.first
    gap = float(np.median(np.diff(replays.times[first[0] : first[1]])))
    stride = max(1, round(STEP / gap))
    count = (int(np.diff(first).min()) - 1) // stride + 1
    if count < 4 or gap > 1.5 * STEP:
        raise InconclusiveError(
            f"--residual: poses every {gap:g} s in windows this short; it needs at least 4 poses "
            f"{STEP:g} s apart in every window"
        )
    rows = first[:-1, None] + stride * np.arange(count)
    states = problem.predicted(cube)[rows]
    latency = problem.space.values(cube)[LATENCY]
    return Stretches(states, _commands(replays, rows, latency), windows.poses[rows], replays.drive)


def _commands(replays: Replays, rows: Integers, latency: float) -> Floats:
    """The commands in force at rows (w, k): (w, k, channels)."""
    found = np.zeros((*rows.shape, len(replays.values)))
    for number, drive in enumerate(replays.drive):
        low, high = replays.held[drive], replays.held[drive + 1]
        at = replays.times[rows[number]] - latency
        k = np.searchsorted(replays.command_time[low:high], at, side="right") - 1
        told = replays.values[:, low:high][:, np.maximum(k, 0)].T
        found[number] = np.where(k[:, None] < 0, 0.0, told)
    return found
