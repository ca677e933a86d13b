"""Heatmap `activation`: contribution of the last convolution's cells to the prediction."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from s2rstore.metrics.pose_metrics import LOSS_GAMMA
from s2rstore.records import SIDES
from s2rtools.heatmaps.heatmap_method import (
    HeatArrays,
    HeatmapKind,
    OutputSpec,
    PairBatch,
    feature_size,
)
from s2rtools.models.pose_network import LoadedModel


class Activation(HeatmapKind):
    """Gradient-weighted regression activation at the last convolution, signed.

    For an output o (x, y, heading) and features A (C, h, w): map = sum_c mean_hw(do/dA_c) A_c.
    Plane `loss` takes o = the loss (1 - g) error^2 + g heading_error of the pose against the
    truth, so that values > 0 mark features that raise the loss. Units: metres for x and y,
    radians for heading, loss for loss. Source: Selvaraju et al., "Grad-CAM", 2017, for regression
    as in Wang and Yang's activation mapping, 2017, without the rectifier.
    """

    name = "activation"
    compares_images = False
    planes = ("x", "y", "heading", "loss")
    uses_features = True

    def outputs(self, model: LoadedModel) -> list[OutputSpec]:
        shape = (len(self.planes), *feature_size(model))
        return [
            OutputSpec(side, None, shape, ("output", "row", "column"), "m m rad loss")
            for side in SIDES
        ]

    def compute(self, pair: PairBatch) -> HeatArrays:
        return {
            (side, None): _maps(pair.model, pair.features(side), pair.side(side).truth)
            for side in SIDES
        }


def _maps(model: LoadedModel, features: Tensor, truth: NDArray[np.float64]) -> NDArray[np.float32]:
    with torch.enable_grad():
        active = features.detach().clone().requires_grad_(True)
        raw = model.network.head(model.network.embed(active))
        pose = model.convention.decode(raw)
        loss = pose_loss(pose, torch.as_tensor(truth, dtype=pose.dtype, device=pose.device))
        maps = []
        for output in (*pose.unbind(dim=1), loss):
            (gradient,) = torch.autograd.grad(output.sum(), active, retain_graph=True)
            weight = gradient.mean(dim=(2, 3), keepdim=True)
            maps.append((weight * active).sum(dim=1))
    return torch.stack(maps, dim=1).detach().cpu().numpy()


def pose_loss(pose: Tensor, truth: Tensor) -> Tensor:
    """(1 - g) |position error|^2 + g |heading error|, shape (B,); poses (B, 3)."""
    angle = torch.remainder(pose[:, 2] - truth[:, 2] + torch.pi, 2 * torch.pi) - torch.pi
    square = (pose[:, :2] - truth[:, :2]).square().sum(dim=1)
    return (1 - LOSS_GAMMA) * square + LOSS_GAMMA * angle.abs()
