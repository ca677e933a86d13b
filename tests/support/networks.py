"""Small networks with random weights, with and without local trunks, and a published one."""

from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from s2rtools.models import build_network
from s2rtools.models.conventions import OutputConvention
from s2rtools.models.pose_network import LoadedModel, PoseNetwork


class SmallPoseNetwork(PoseNetwork):
    """A given trunk with the usual pooled head."""

    architecture: ClassVar[str] = "small"
    convention = OutputConvention("cos_sin")

    def __init__(self, trunk: nn.Module, channels: int, size: tuple[int, int]) -> None:
        super().__init__()
        self.inner = trunk
        self.input_size = size
        self.embedding_size = channels * 4
        self.out = nn.Linear(self.embedding_size, 4)

    @property
    def trunk(self) -> nn.Module:
        return self.inner

    @property
    def early(self) -> nn.Module | None:
        return self.inner[:2] if isinstance(self.inner, nn.Sequential) else None

    def embed(self, features: Tensor) -> Tensor:
        return functional.adaptive_avg_pool2d(features, 2).flatten(1)

    def head(self, embedding: Tensor) -> Tensor:
        return self.out(embedding)


class ResidualBlock(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv = nn.Conv2d(channels, channels, 3, padding=1)
        self.norm = nn.BatchNorm2d(channels)

    def forward(self, x: Tensor) -> Tensor:
        return torch.relu(x + self.norm(self.conv(x)))


class Branches(nn.Module):
    """Two branches with different receptive fields, concatenated by channels."""

    def __init__(self) -> None:
        super().__init__()
        self.wide = nn.Conv2d(4, 6, 5, padding=2, stride=2)
        self.narrow = nn.Conv2d(4, 3, 1, stride=2)
        self.after = nn.Conv2d(9, 8, 3, padding=1, dilation=1)

    def forward(self, x: Tensor) -> Tensor:
        joined = torch.cat([self.wide(x), self.narrow(x)], dim=1)
        return functional.relu(self.after(joined))


class SelfConcatenation(nn.Module):
    """A tensor concatenated with itself."""

    def __init__(self) -> None:
        super().__init__()
        self.conv = nn.Conv2d(4, 4, 3, padding=1)
        self.after = nn.Conv2d(8, 8, 3, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        y = torch.relu(self.conv(x))
        return self.after(torch.cat([y, y], 1))


class SqueezeExcite(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.conv = nn.Conv2d(4, 8, 3, padding=1)
        self.gate = nn.Linear(8, 8)

    def forward(self, x: Tensor) -> Tensor:
        y = self.conv(x)
        return y * torch.sigmoid(self.gate(y.mean(dim=(2, 3))))[:, :, None, None]


def local_trunks() -> dict[str, tuple[nn.Module, int]]:
    """Trunks that support incremental inference, with their channel counts."""
    return {
        "plain": (nn.Sequential(nn.Conv2d(4, 8, 3, padding=1), nn.ReLU(inplace=True)), 8),
        "strided": (
            nn.Sequential(
                nn.Conv2d(4, 8, 5, stride=2, padding=2), nn.BatchNorm2d(8), nn.ReLU(),
                nn.MaxPool2d(2), nn.Conv2d(8, 8, 3), nn.LeakyReLU(), nn.AvgPool2d(2),
            ), 8,
        ),
        "overlapping pool": (
            nn.Sequential(
                nn.Conv2d(4, 6, 3, padding=1), nn.MaxPool2d(3, stride=2, padding=1),
                nn.Conv2d(6, 8, 3, padding=2, dilation=2), nn.GELU(),
            ), 8,
        ),
        "residual": (
            nn.Sequential(nn.Conv2d(4, 8, 3, padding=1), nn.ReLU(), nn.MaxPool2d(2),
                          ResidualBlock(8), ResidualBlock(8)), 8,
        ),
        "branches": (Branches(), 8),
        "twice": (SelfConcatenation(), 8),
    }  # fmt: skip


def nonlocal_trunks() -> dict[str, tuple[nn.Module, int]]:
    """Trunks with a global operation, with their channel counts."""
    return {
        "group norm": (nn.Sequential(nn.Conv2d(4, 8, 3, padding=1), nn.GroupNorm(2, 8)), 8),
        "instance norm": (nn.Sequential(nn.Conv2d(4, 8, 3), nn.InstanceNorm2d(8)), 8),
        "global pool": (nn.Sequential(nn.Conv2d(4, 8, 3), nn.AdaptiveAvgPool2d(6)), 8),
        "squeeze excite": (SqueezeExcite(), 8),
        "batch statistics": (
            nn.Sequential(
                nn.Conv2d(4, 8, 3, padding=1), nn.BatchNorm2d(8, track_running_stats=False)
            ), 8,
        ),
        "divided pool": (
            nn.Sequential(nn.Conv2d(4, 8, 3), nn.AvgPool2d(2, divisor_override=1)), 8,
        ),
    }  # fmt: skip


def randomize_weights(network: nn.Module, seed: int = 0) -> nn.Module:
    """Set random weights and statistics that preserve the signal's scale in every layer."""
    generator = torch.Generator().manual_seed(seed)
    for module in network.modules():
        if isinstance(module, nn.Conv2d | nn.Linear):
            fan_in = module.weight[0].numel()
            with torch.no_grad():
                module.weight.copy_(
                    torch.randn(module.weight.shape, generator=generator) * (2 / fan_in) ** 0.5
                )
                if module.bias is not None:
                    module.bias.copy_(torch.randn(module.bias.shape, generator=generator) * 0.1)
        if isinstance(module, nn.BatchNorm2d) and module.running_mean is not None:
            module.running_mean.copy_(torch.randn(module.num_features, generator=generator) * 0.1)
            module.running_var.copy_(torch.rand(module.num_features, generator=generator) + 0.5)
    return network.eval().requires_grad_(False)


def small_model(trunk: nn.Module, channels: int, size: tuple[int, int]) -> LoadedModel:
    network = SmallPoseNetwork(trunk, channels, size)
    randomize_weights(network)
    return LoadedModel("small", "small", network, network.convention, "0" * 64)


def build_model(architecture: str) -> LoadedModel:
    network = build_network(architecture)
    randomize_weights(network)
    heading = "cos_sin" if architecture == "resposenet" else "radians"
    return LoadedModel(architecture, architecture, network, OutputConvention(heading), "0" * 64)


class PlainPosEst(nn.Module):
    """The network of the Sim2RealViz authors, written down from its paper and state dict."""

    def __init__(self) -> None:
        super().__init__()
        widths, pools = (4, 16, 32, 64, 128, 256, 512, 256), (0, 1, 3, 5)
        layers: list[nn.Module] = []
        for k in range(7):
            layers += [nn.Conv2d(widths[k], widths[k + 1], 3, padding=1),
                       nn.BatchNorm2d(widths[k + 1]), nn.ReLU()]  # fmt: skip
            if k in pools:
                layers.append(nn.MaxPool2d(2))
        self.conv_head = nn.Sequential(*layers)
        self.avgpool = nn.AdaptiveAvgPool2d(4)
        self.fc1 = nn.Linear(4096, 256)
        self.fc3 = nn.Linear(256, 3)

    def forward(self, x: Tensor) -> Tensor:
        pooled = self.avgpool(self.conv_head(x)).flatten(1)
        return self.fc3(torch.relu(self.fc1(pooled)))
