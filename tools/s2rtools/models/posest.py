"""The pose network of the Sim2RealViz paper."""

from __future__ import annotations

from itertools import pairwise
from typing import ClassVar

import torch
from torch import Tensor, nn

from s2rtools.models.conventions import OutputConvention
from s2rtools.models.input_contract import InputContract
from s2rtools.models.pose_network import PoseNetwork

_CHANNELS = (4, 16, 32, 64, 128, 256, 512, 256)
_POOL_AFTER = (1, 2, 4, 6)
_POOLED = 4


class PosEst(PoseNetwork):
    """Seven 3x3 convolutions, 4x256x256 in, features 256x16x16, embedding 4096, output 3.

    State-dict names are the published ones: `conv_head.N.*` where N counts convolution, batch
    norm, ReLU and pool in order (convolutions at 0, 4, 8, 11, 15, 18, 22), `fc1`, `fc3`. The
    published checkpoints give x, y in metres and Habitat's yaw in degrees.
    """

    architecture: ClassVar[str] = "posest"
    convention = OutputConvention("degrees", "habitat")
    input_size = (256, 256)
    embedding_size = _CHANNELS[-1] * _POOLED * _POOLED

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for number, (inputs, outputs) in enumerate(pairwise(_CHANNELS), 1):
            layers += [nn.Conv2d(inputs, outputs, 3, padding=1), nn.BatchNorm2d(outputs), nn.ReLU()]
            if number in _POOL_AFTER:
                layers.append(nn.MaxPool2d(2))
        self.conv_head = nn.Sequential(*layers)
        self.avgpool = nn.AdaptiveAvgPool2d(_POOLED)
        self.fc1 = nn.Linear(self.embedding_size, 256)
        self.relu = nn.ReLU()
        self.fc3 = nn.Linear(256, 3)

    @property
    def contract(self) -> InputContract:
        """As the authors load images: `cv2.resize` by default, bilinear without anti-aliasing."""
        return InputContract(
            size=self.input_size, rgb_interpolation="bilinear", depth_interpolation="bilinear"
        )

    @property
    def trunk(self) -> nn.Module:
        return self.conv_head

    @property
    def early(self) -> nn.Module:
        return self.conv_head[:3]

    @property
    def average_pool(self) -> nn.AdaptiveAvgPool2d:
        return self.avgpool

    def embed(self, features: Tensor) -> Tensor:
        return torch.flatten(self.avgpool(features), 1)

    def head(self, embedding: Tensor) -> Tensor:
        raw: Tensor = self.fc3(self.relu(self.fc1(embedding)))
        return raw

    @torch.no_grad()
    def centre_output(self, centre: tuple[float, float], spread: float) -> None:
        """Rescale the last layer: metres by `spread`, degrees by the size of a radian."""
        units = torch.tensor([spread, spread, 180 / torch.pi])
        self.fc3.weight.mul_(units[:, None])
        self.fc3.bias.copy_(torch.tensor([*centre, 0.0]))
