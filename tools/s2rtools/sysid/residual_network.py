"""A network that adds accelerations to a simulator, integrated over whole windows.

Its inputs are the corrected speeds, the correction, the delayed commands and the cosine and sine of
the heading, all scaled by the training windows; its outputs are additions to both accelerations.
The last layer is initialised with zeros, which leaves the simulation unchanged. The loss covers all
steps of a window: errors of the position, and of the cosine and sine of the heading.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor, nn

from s2rstore.errors import InconclusiveError
from s2rtools.sysid.identify import Identification
from s2rtools.sysid.prediction_error import HeldOut, PredictionError, compared
from s2rtools.sysid.simulators.simulator import LATENCY, Floats, Integers, Replays, Values

if TYPE_CHECKING:
    from s2rtools.common.command_line.progress import Reporter


STEP = 0.1
"""Time between two corrections, s."""
_WIDTH, _DROPOUT, _RATE, _DECAY, _PATIENCE = 24, 0.1, 5e-3, 1e-4, 25
MIN_HELD_OUT = 2
"""Fewest held-out drives on which a network can be accepted."""


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


class CorrectionNetwork(nn.Module):
    """Correction network with scales from `training`; equal seeds give equal networks."""

    def __init__(self, training: Stretches, seed: int) -> None:
        super().__init__()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            channels = training.commands.shape[-1]
            self.layers = nn.Sequential(
                nn.Linear(6 + channels, _WIDTH), nn.Tanh(), nn.Dropout(_DROPOUT),
                nn.Linear(_WIDTH, _WIDTH), nn.Tanh(), nn.Dropout(_DROPOUT),
                nn.Linear(_WIDTH, 2),
            ).double()  # fmt: skip
        last = self.layers[-1]
        assert isinstance(last, nn.Linear)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        speeds = training.states[:, :, 3:]
        self.register_buffer("speeds", torch.tensor(_rms(speeds)))
        self.register_buffer("commands", torch.tensor(_rms(training.commands)))
        self.register_buffer("push", torch.tensor(_rms(speeds - speeds[:, :1])))
        off = training.states[:, 1:, :3] - training.poses[:, 1:]
        position = float(np.sqrt((off[:, :, :2] ** 2).sum(axis=-1).mean()))
        heading = float(np.sqrt((off[:, :, 2] ** 2).mean()))
        self.position_scale, self.heading_scale = max(position, 1e-4), max(heading, 1e-4)

    def forward(self, states: Tensor, commands: Tensor, period: float) -> Tensor:
        """Corrected poses (w, k, 3): x, y, heading."""
        speeds, push = self.get_buffer("speeds"), self.get_buffer("push")
        scaled = commands / self.get_buffer("commands")
        x, y, heading = states[:, 0, 0], states[:, 0, 1], states[:, 0, 2]
        extra = torch.zeros_like(states[:, 0, 3:])
        poses = [torch.stack([x, y, heading], dim=1)]
        for k in range(states.shape[1] - 1):
            now = (states[:, k, 3:] + extra) / speeds
            direction = torch.stack([heading.cos(), heading.sin()], dim=1)
            inputs = torch.cat([now, extra / speeds, scaled[:, k], direction], dim=1)
            before = extra
            extra = extra + period * push * self.layers(inputs)
            mean = 0.5 * (before + extra)
            step = states[:, k + 1, :3] - states[:, k, :3]
            off = heading - states[:, k, 2] + 0.5 * period * mean[:, 1]
            ahead = heading + 0.5 * (step[:, 2] + period * mean[:, 1])
            cos, sin = off.cos(), off.sin()
            x = x + cos * step[:, 0] - sin * step[:, 1] + period * mean[:, 0] * ahead.cos()
            y = y + sin * step[:, 0] + cos * step[:, 1] + period * mean[:, 0] * ahead.sin()
            heading = heading + step[:, 2] + period * mean[:, 1]
            poses.append(torch.stack([x, y, heading], dim=1))
        return torch.stack(poses, dim=1)

    def loss(self, stretches: Stretches) -> Tensor:
        """Mean scaled square error; 1 for the simulator alone on the training windows."""
        real = torch.from_numpy(stretches.poses)[:, 1:]
        poses = self(*_tensors(stretches))[:, 1:]
        position = ((poses[:, :, :2] - real[:, :, :2]) ** 2).sum(dim=-1) / self.position_scale**2
        heading = (poses[:, :, 2].cos() - real[:, :, 2].cos()) ** 2
        heading = heading + (poses[:, :, 2].sin() - real[:, :, 2].sin()) ** 2
        return 0.5 * (position + heading / self.heading_scale**2).mean()

    @torch.no_grad()
    def poses(self, stretches: Stretches) -> Floats:
        """Corrected poses (w, k, 3), without dropout."""
        self.eval()
        return np.asarray(self(*_tensors(stretches)).numpy())

    def saved(self, values: Values) -> bytes:
        """A safetensors file; its metadata hold inputs, outputs, step and simulator `values`."""
        from safetensors.torch import save

        description = {
            "inputs": ["speed", "turn rate", "added speed", "added turn rate", "commands",
                       "cos heading", "sin heading"],
            "outputs": ["added acceleration", "added turn acceleration"],
            "step": STEP, "values": dict(values),
        }  # fmt: skip
        tensors = {name: tensor.contiguous() for name, tensor in self.state_dict().items()}
        return bytes(save(tensors, {"description": json.dumps(description, sort_keys=True)}))


def train(correction: CorrectionNetwork, training: Stretches, stopping: Stretches, epochs: int,
          reporter: Reporter) -> None:  # fmt: skip
    """Train by full-batch Adam with early stopping; restore the weights with the least loss on
    `stopping`, which may be the initial ones."""

    @torch.no_grad()
    def stopping_loss() -> float:
        correction.eval()
        return float(correction.loss(stopping))

    def copied_weights() -> dict[str, Tensor]:
        return {name: tensor.clone() for name, tensor in correction.state_dict().items()}

    optimiser = torch.optim.AdamW(correction.parameters(), _RATE, weight_decay=_DECAY)
    reporter.begin("residual network", epochs)
    best, weights, since = stopping_loss(), copied_weights(), 0
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        for epoch in range(epochs):
            correction.train()
            optimiser.zero_grad()
            loss = correction.loss(training)
            torch.autograd.backward(loss)
            nn.utils.clip_grad_norm_(correction.parameters(), 1.0)
            optimiser.step()
            reporter.advance(1)
            now = stopping_loss()
            since += 1
            if now < best:
                best, weights, since = now, copied_weights(), 0
            if since > _PATIENCE:
                reporter.advance(epochs - epoch - 1)
                break
    correction.load_state_dict(weights)


def _tensors(stretches: Stretches) -> tuple[Tensor, Tensor, float]:
    return torch.from_numpy(stretches.states), torch.from_numpy(stretches.commands), STEP


def _rms(values: Floats) -> Floats:
    """Root mean square of the last axis' columns, at least 1e-3."""
    return np.maximum(np.sqrt((values.reshape(-1, values.shape[-1]) ** 2).mean(axis=0)), 1e-3)


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


def learn(result: Identification, reporter: Reporter, epochs: int = 200) -> Residual:
    """Train on fitted drives, with a quarter of them for early stopping; judge on held-out drives.

    Raises InconclusiveError where the logs are too coarse for steps of `STEP`.
    """
    stretches = stretches_of(result.everything, result.cube)
    fitted = len(result.fitted)
    trained = fitted - max(1, fitted // 4)
    training = stretches.of(stretches.drive < trained)
    stopping = stretches.of((stretches.drive >= trained) & (stretches.drive < fitted))
    held_out = stretches.of(stretches.drive >= fitted)
    correction = CorrectionNetwork(training, result.settings.seed)
    train(correction, training, stopping, epochs, reporter)
    error = compared(_errors(held_out.states[:, :, :3], held_out.poses),
                     _errors(correction.poses(held_out), held_out.poses),
                     held_out.drive)  # fmt: skip
    return Residual(error, correction.saved(result.values))


def _errors(poses: Floats, real: Floats) -> Floats:
    """Root mean square position and heading errors (w, 2)."""
    x, y, heading = np.moveaxis(poses[:, 1:] - real[:, 1:], -1, 0)
    return np.sqrt(np.stack([(x**2 + y**2).mean(axis=1), (heading**2).mean(axis=1)], axis=1))
