"""Attribute the error of a prediction to changed segments and to pixels.

Errors are position error in metres, heading error in radians, and the loss.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from s2rstore.geometry import angles
from s2rstore.metrics.pose_metrics import LOSS_GAMMA, pose_loss
from s2rtools.counterfactual.counterfactual_inputs import CounterfactualInputs
from s2rtools.inference import Backend


def pose_errors(poses: NDArray[np.float64], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Position error in metres, heading error in radians and loss of poses (n, 3), as (n, 3)."""
    position = np.hypot(poses[:, 0] - truth[0], poses[:, 1] - truth[1])
    heading = angles.distance(poses[:, 2], truth[2])
    return np.stack([position, heading, pose_loss(position, heading)], axis=1)


def repair_gains(
    backend: Backend, inputs: CounterfactualInputs, truth: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Decrease (n, 3) of position error, heading error and loss by repairing each segment alone."""
    errors = pose_errors(backend.poses(inputs.repaired()), truth)
    gains: NDArray[np.float64] = errors[0] - errors[1:]
    return gains


def integrated_gradients(
    backend: Backend, inputs: CounterfactualInputs, truth: NDArray[np.float64], steps: int
) -> NDArray[np.float32]:
    """Contributions (3, C, h, w) of the input's values to the three errors of `pose_errors`.

    Each sums to the error of the real input minus that of the counterfactual, up to the error of
    `steps` points of the integral.
    """
    first, rest = backend.split_trunk
    ends = np.stack([inputs.counterfactual, inputs.real])
    x = torch.from_numpy(ends).to(backend.device).contiguous(memory_format=torch.channels_last)
    target = torch.as_tensor(truth, dtype=torch.float32, device=backend.device)
    shares = (torch.arange(steps, device=backend.device) + 0.5) / steps
    with torch.no_grad():
        start, end = first(x)
    total = start.new_zeros(3, *start.shape)
    for part in shares.split(max(1, backend.batch)):
        between = torch.lerp(start[None], end[None], part[:, None, None, None])
        total += _gradients(backend, rest, between, target)
    way = x[1] - x[0]
    with torch.enable_grad():
        # The first part is linear: its gradient is the same all along the line.
        ways = way.repeat(3, 1, 1, 1).contiguous(memory_format=torch.channels_last)
        ways.requires_grad_(True)
        (gradients,) = torch.autograd.grad(first(ways), ways, total / steps)
    return np.asarray((gradients * way).contiguous().cpu().numpy(), dtype=np.float32)


def _gradients(backend: Backend, rest: nn.Module, features: Tensor, target: Tensor) -> Tensor:
    """Sums (3, F, h, w) of the gradients of the three errors over features (n, F, h, w).

    The trunk's `rest` takes the features.
    """
    model = backend.model
    with torch.enable_grad():
        x = features.contiguous(memory_format=torch.channels_last).requires_grad_(True)
        embedding = model.network.embed(rest(x.clone()))  # its layers may write in place
        pose = model.convention.decode(model.network.head(embedding))
        position = (pose[:, :2] - target[:2]).square().sum(dim=1).clamp_min(1e-12).sqrt()
        turn = torch.remainder(pose[:, 2] - target[2] + torch.pi, 2 * torch.pi) - torch.pi
        along_position = _gradient(position, x, keep=True)
        along_heading = _gradient(turn.abs(), x, keep=False)
    weights = torch.stack([torch.ones_like(position), 2 * (1 - LOSS_GAMMA) * position]).detach()
    of_position, of_square = _weighted_sums(weights, along_position)
    (of_heading,) = _weighted_sums(weights[:1], along_heading)
    return torch.stack([of_position, of_heading, of_square + LOSS_GAMMA * of_heading])


def _weighted_sums(weights: Tensor, gradients: Tensor) -> Tensor:
    """Sums (m, C, h, w) of gradients (n, C, h, w) in the layout channels_last, weights (m, n)."""
    pixels = gradients.permute(0, 2, 3, 1)
    sums = weights @ pixels.reshape(len(pixels), -1)
    return sums.reshape(len(weights), *pixels.shape[1:]).permute(0, 3, 1, 2)


def _gradient(output: Tensor, x: Tensor, keep: bool) -> Tensor:
    (found,) = torch.autograd.grad(output.sum(), x, retain_graph=keep)
    return found
