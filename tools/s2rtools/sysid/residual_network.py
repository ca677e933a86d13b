"""A network that adds accelerations to a simulator, stepped through whole windows.

It sees the corrected speeds, the correction itself, the delayed commands and the heading's cosine
and sine, all scaled by the training windows, and gives what to add to both accelerations. Its last
layer begins at zero, where the corrected robot is the simulated one. The loss is over all steps of
a window: errors of place, and of the heading's cosine and sine.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor, nn

from s2rtools.sysid.simulators.simulator import Floats, Values

if TYPE_CHECKING:
    from s2rtools.precompute.pipeline import ProgressReporter
    from s2rtools.sysid.residual_training import Stretches

_WIDTH, _DROPOUT, _RATE, _DECAY, _PATIENCE = 24, 0.1, 5e-3, 1e-4, 25


class ResidualNetwork(nn.Module):
    """Scaled by `training`; one seed gives one network."""

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
        speeds = _spread(training.states[:, :, 3:])
        drift = _spread(training.states[:, :, 3:] - training.states[:, :1, 3:])
        self.register_buffer("speeds", torch.tensor(speeds))
        self.register_buffer("commands", torch.tensor(_spread(training.commands)))
        self.register_buffer("push", torch.tensor(np.maximum(drift, 1e-3)))
        off = training.states[:, 1:, :3] - training.poses[:, 1:]
        place = float(np.sqrt((off[:, :, :2] ** 2).sum(axis=-1).mean()))
        turn = float(np.sqrt((off[:, :, 2] ** 2).mean()))
        self.place, self.turn = max(place, 1e-4), max(turn, 1e-4)

    def forward(self, states: Tensor, commands: Tensor, period: float) -> Tensor:
        """Corrected poses (w, k, 3): x, y, heading."""
        speeds, push = self.get_buffer("speeds"), self.get_buffer("push")
        told = commands / self.get_buffer("commands")
        x, y, heading = states[:, 0, 0], states[:, 0, 1], states[:, 0, 2]
        extra = torch.zeros_like(states[:, 0, 3:])
        found = [torch.stack([x, y, heading], dim=1)]
        for k in range(states.shape[1] - 1):
            now = (states[:, k, 3:] + extra) / speeds
            seen = [now, extra / speeds, told[:, k], heading.cos()[:, None], heading.sin()[:, None]]
            before = extra
            extra = extra + period * push * self.layers(torch.cat(seen, dim=1))
            mean = 0.5 * (before + extra)
            step = states[:, k + 1, :3] - states[:, k, :3]
            off = heading - states[:, k, 2] + 0.5 * period * mean[:, 1]
            ahead = heading + 0.5 * (step[:, 2] + period * mean[:, 1])
            cos, sin = off.cos(), off.sin()
            x = x + cos * step[:, 0] - sin * step[:, 1] + period * mean[:, 0] * ahead.cos()
            y = y + sin * step[:, 0] + cos * step[:, 1] + period * mean[:, 0] * ahead.sin()
            heading = heading + step[:, 2] + period * mean[:, 1]
            found.append(torch.stack([x, y, heading], dim=1))
        return torch.stack(found, dim=1)

    def loss(self, stretches: Stretches) -> Tensor:
        """1 for the simulator alone, on the training windows."""
        real = torch.from_numpy(stretches.poses)[:, 1:]
        found = self(*_tensors(stretches))[:, 1:]
        place = ((found[:, :, :2] - real[:, :, :2]) ** 2).sum(dim=-1) / self.place**2
        turned = (found[:, :, 2].cos() - real[:, :, 2].cos()) ** 2
        turned = turned + (found[:, :, 2].sin() - real[:, :, 2].sin()) ** 2
        return 0.5 * (place + turned / self.turn**2).mean()

    @torch.no_grad()
    def poses(self, stretches: Stretches) -> Floats:
        """Corrected poses (w, k, 3), without dropout."""
        self.eval()
        return np.asarray(self(*_tensors(stretches)).numpy())

    def saved(self, values: Values) -> bytes:
        """A safetensors file; its metadata tell the inputs, the step and the simulator's values."""
        from safetensors.torch import save

        from s2rtools.sysid.residual_training import STEP

        told = {
            "inputs": ["speed", "turn rate", "added speed", "added turn rate", "commands",
                       "cos heading", "sin heading"],
            "outputs": ["added acceleration", "added turn acceleration"],
            "step": STEP, "values": dict(values),
        }  # fmt: skip
        tensors = {name: tensor.contiguous() for name, tensor in self.state_dict().items()}
        return bytes(save(tensors, {"description": json.dumps(told, sort_keys=True)}))


def train(correction: ResidualNetwork, training: Stretches, stopping: Stretches, epochs: int,
          reporter: ProgressReporter) -> None:  # fmt: skip
    """Full-batch Adam; keeps the weights that were best on `stopping`, the first among them."""
    optimiser = torch.optim.AdamW(correction.parameters(), _RATE, weight_decay=_DECAY)
    reporter.begin("residual network", epochs)
    best, kept, since = _judged(correction, stopping), _copied(correction), 0
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
            now = _judged(correction, stopping)
            since += 1
            if now < best:
                best, kept, since = now, _copied(correction), 0
            if since > _PATIENCE:
                reporter.advance(epochs - epoch - 1)
                break
    correction.load_state_dict(kept)


@torch.no_grad()
def _judged(correction: ResidualNetwork, stretches: Stretches) -> float:
    correction.eval()
    return float(correction.loss(stretches))


def _copied(correction: ResidualNetwork) -> dict[str, Tensor]:
    return {name: tensor.clone() for name, tensor in correction.state_dict().items()}


def _tensors(stretches: Stretches) -> tuple[Tensor, Tensor, float]:
    from s2rtools.sysid.residual_training import STEP

    return torch.from_numpy(stretches.states), torch.from_numpy(stretches.commands), STEP


def _spread(values: Floats) -> Floats:
    return np.maximum(np.sqrt((values.reshape(-1, values.shape[-1]) ** 2).mean(axis=0)), 1e-3)
