"""A small network trained on the residuals of the identified simulator, accepted if it helps."""

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
    from s2rtools.common.command_line.progress import Reporter

STEP = 0.1
"""Time between two corrections, s."""
MIN_HELD_OUT = 2
"""Fewest held-out drives on which a network can be accepted."""


@dataclass(frozen=True, slots=True)
class Residual:
    """A trained network: `weights` are the bytes of a safetensors file, `error` compares the
    simulator without and with the network on held-out windows."""

    error: HeldOut
    weights: bytes

    @property
    def accepted(self) -> bool:
        """Whether the network improves the prediction, on enough held-out drives."""
        return self.error.helps and self.error.drives >= MIN_HELD_OUT

    @property
    def sentence(self) -> str:
        """The verdict and the errors, for the reader of a report."""
        error = self.error
        verdict = "helps" if self.accepted else "does not help and is discarded"
        if error.drives < MIN_HELD_OUT:
            verdict = f"discarded, because judging it needs {MIN_HELD_OUT} held-out drives"
        bounds = error.ratio.bounds_text(to=" .. ")
        turn = 57.29578 * error.untuned[1], 57.29578 * error.fitted[1]
        without, with_it = 100 * error.untuned[0], 100 * error.fitted[0]
        return (
            f"residual network: {verdict}; error on held-out windows {without:.2f} cm without and "
            f"{with_it:.2f} cm with it, ratio {error.ratio.value:.2f} ({bounds}); headings "
            f"{turn[0]:.2f} and {turn[1]:.2f} degrees"
        )

    def record(self) -> dict[str, Any]:
        """JSON data with six significant digits."""
        names = {"untuned": "without", "fitted": "with"}
        error = {names.get(key, key): value for key, value in self.error.record().items()}
        del error["helps"]
        return {"accepted": self.accepted, "sentence": self.sentence, **error}


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


def learn(result: Identification, reporter: Reporter, epochs: int = 200) -> Residual:
    """Train on fitted drives, with a quarter of them for early stopping; judge on held-out drives.

    Raises InconclusiveError where the logs are too coarse for steps of `STEP`.
    """
    from s2rtools.sysid.residual_network import ResidualNetwork, train

    stretches = _stretches(result.everything, result.cube)
    fitted = len(result.fitted)
    trained = fitted - max(1, fitted // 4)
    training = stretches.of(stretches.drive < trained)
    stopping = stretches.of((stretches.drive >= trained) & (stretches.drive < fitted))
    held_out = stretches.of(stretches.drive >= fitted)
    correction = ResidualNetwork(training, result.settings.seed)
    train(correction, training, stopping, epochs, reporter)
    error = compared(_errors(held_out.states[:, :, :3], held_out.poses),
                     _errors(correction.poses(held_out), held_out.poses),
                     held_out.drive)  # fmt: skip
    return Residual(error, correction.saved(result.values))


def _errors(poses: Floats, real: Floats) -> Floats:
    """Root mean square position and heading errors (w, 2)."""
    x, y, heading = np.moveaxis(poses[:, 1:] - real[:, 1:], -1, 0)
    return np.sqrt(np.stack([(x**2 + y**2).mean(axis=1), (heading**2).mean(axis=1)], axis=1))


def _stretches(problem: PredictionError, cube: Floats) -> Stretches:
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
