"""A small pose network that trains in minutes on a CPU."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor, nn

from s2rtools.models.conventions import OutputConvention
from s2rtools.models.pose_network import PoseNetwork

_POOLED = 4


def _convolution(inputs: int, outputs: int, stride: int = 1) -> list[nn.Module]:
    return [
        nn.Conv2d(inputs, outputs, 3, stride=stride, padding=1, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(),
    ]


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions around a sum: (B, C, h, w) -> the same shape."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.inner = nn.Sequential(
            *_convolution(channels, channels), *_convolution(channels, channels)[:2]
        )
        self.relu = nn.ReLU()

    def forward(self, x: Tensor) -> Tensor:
        out: Tensor = self.relu(x + self.inner(x))
        return out


class ResPoseNet(PoseNetwork):
    """About 250,000 parameters: 4x128x128 in, features 64x16x16, embedding 1024, output 4.

    Output: x, y in metres of the map and cosine and sine of the heading. Every operation up to
    the last convolution is local at inference: convolution, batch norm, ReLU, pool, sum.
    """

    architecture: ClassVar[str] = "resposenet"
    convention = OutputConvention("cos_sin", "map")
    input_size = (128, 128)
    embedding_size = 64 * _POOLED * _POOLED

    output_scale: Tensor
    output_offset: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.backbone = nn.Sequential(
            *_convolution(4, 24, stride=2),
            nn.MaxPool2d(2),
            *_convolution(24, 32),
            ResidualBlock(32),
            nn.MaxPool2d(2),
            *_convolution(32, 64),
            ResidualBlock(64),
            *_convolution(64, 64),
        )
        self.pool = nn.AdaptiveAvgPool2d(_POOLED)
        self.hidden = nn.Linear(self.embedding_size, 96)
        self.relu = nn.ReLU()
        self.output = nn.Linear(96, 4)
        self.register_buffer("output_scale", torch.ones(4))
        self.register_buffer("output_offset", torch.zeros(4))

    @property
    def trunk(self) -> nn.Module:
        return self.backbone

    @property
    def early(self) -> nn.Module:
        return self.backbone[:3]

    @property
    def average_pool(self) -> nn.AdaptiveAvgPool2d:
        return self.pool

    def embed(self, features: Tensor) -> Tensor:
        return torch.flatten(self.pool(features), 1)

    def head(self, embedding: Tensor) -> Tensor:
        raw: Tensor = self.output(self.relu(self.hidden(embedding)))
        return raw * self.output_scale + self.output_offset

    @torch.no_grad()
    def centre_output(self, centre: tuple[float, float], spread: float) -> None:
        self.output_scale.copy_(torch.tensor([spread, spread, 1.0, 1.0]))
        self.output_offset.copy_(torch.tensor([*centre, 0.0, 0.0]))
