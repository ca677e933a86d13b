"""Architecture `small`: three convolutions and one layer."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor, nn

from s2rtools.models.conventions import OutputConvention
from s2rtools.models.pose_network import PoseNetwork


class Small(PoseNetwork):
    """4 x 64 x 64 in, features 16 x 8 x 8; output: metres, cosine and sine of the heading."""

    architecture: ClassVar[str] = "small"
    convention = OutputConvention("cos_sin", "map")
    input_size = (64, 64)
    embedding_size = 16

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for inputs, outputs in ((4, 8), (8, 16), (16, 16)):
            layers += [nn.Conv2d(inputs, outputs, 3, stride=2, padding=1), nn.ReLU()]
        self.convolutions = nn.Sequential(*layers)
        self.pool = nn.AdaptiveAvgPool2d(1)
        self.last = nn.Linear(self.embedding_size, 4)

    @property
    def trunk(self) -> nn.Module:
        return self.convolutions

    @property
    def early(self) -> nn.Module:
        return self.convolutions[:1]

    @property
    def average_pool(self) -> nn.AdaptiveAvgPool2d:
        return self.pool

    def embed(self, features: Tensor) -> Tensor:
        return torch.flatten(self.pool(features), 1)

    def head(self, embedding: Tensor) -> Tensor:
        raw: Tensor = self.last(embedding)
        return raw

    @torch.no_grad()
    def centre_output(self, centre: tuple[float, float], spread: float) -> None:
        self.last.bias.copy_(torch.tensor([*centre, 0.0, 0.0]))
