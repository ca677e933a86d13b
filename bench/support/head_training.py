"""Fine-tune the layers after the embedding alone: seconds instead of half a minute.

The images of recipe `finetune` in random colours are embedded once, `COPIES` times each; batch norm
stays as it was.
"""

from __future__ import annotations

import copy

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from s2rtools.models.pose_network import LoadedModel
from s2rtools.training.recipes import RECIPES
from s2rtools.training.training_frames import CopiedFrames
from s2rtools.training.training_loop import (
    WEIGHT_DECAY,
    learning_rate_share,
    training_loss,
)

COPIES = 2
STEPS = 150
_BATCH = 64


def embeddings(model: LoadedModel, frames: CopiedFrames, colours: int | None = None) -> Tensor:
    """Embeddings (n, E) of all frames, in random colours where a seed is given."""
    network, parts = model.network, []
    generator = torch.Generator().manual_seed(colours or 0)
    change = RECIPES["finetune"].augmentation(model.contract.size, 0)
    with torch.inference_mode():
        for start in range(0, len(frames.rgb), _BATCH):
            rows = np.arange(start, min(start + _BATCH, len(frames.rgb)))
            x = torch.from_numpy(frames.inputs(rows))
            if colours is not None:
                x = change(x, generator)
            parts.append(network.embed(network.trunk(x.contiguous(
                memory_format=torch.channels_last))))  # fmt: skip
    return torch.cat(parts)


def trained_head_poses(
    model: LoadedModel,
    sources: list[tuple[CopiedFrames, NDArray[np.float64]]],
    held_out: Tensor,
    seed: int,
) -> NDArray[np.float64]:
    """Poses (n, 3) of held-out embeddings (n, E) after training the head on frames with poses.

    Each of the `sources`, sim and real images, gives half of every batch.
    """
    network = copy.deepcopy(model.network)
    inputs, targets = [], []
    for frames, poses in sources:
        copies = [embeddings(model, frames, 1 + seed * COPIES + k) for k in range(COPIES)]
        inputs.append(torch.stack(copies, dim=1).clone())
        truth = np.column_stack([poses[:, :2], np.cos(poses[:, 2]), np.sin(poses[:, 2])])
        targets.append(torch.from_numpy(truth.astype(np.float32)))
    head = head_parameters(network)
    rate = RECIPES["finetune"].learning_rate
    optimizer = torch.optim.AdamW(head, rate, weight_decay=WEIGHT_DECAY)
    rng = np.random.default_rng([seed, 104])
    half = _BATCH // len(sources)
    for step in range(STEPS):
        batch, truth_of = [], []
        for images, target in zip(inputs, targets, strict=True):
            rows = torch.from_numpy(rng.integers(len(images), size=half))
            batch.append(images[rows, torch.from_numpy(rng.integers(COPIES, size=half))])
            truth_of.append(target[rows])
        for group in optimizer.param_groups:
            group["lr"] = rate * learning_rate_share(step / STEPS)
        raw = network.head(torch.cat(batch))
        loss = training_loss(model.convention.components(raw), torch.cat(truth_of))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    with torch.inference_mode():
        return model.convention.decode(network.head(held_out).double()).numpy()


def head_parameters(network: nn.Module) -> list[nn.Parameter]:
    """The weights of `hidden` and `output` of a ResPoseNet, which alone are trained."""
    head = [*network.hidden.parameters(), *network.output.parameters()]
    for parameter in head:
        parameter.requires_grad_(True)
    return head
