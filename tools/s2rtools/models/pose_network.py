"""Interface of pose networks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor, nn

from s2rtools.models.conventions import OutputConvention
from s2rtools.models.input_contract import InputContract


class PoseNetwork(nn.Module):
    """A network from images to a pose, in three steps that can be called separately.

    Input x is (B, C, h, w) float32 as `contract` states; the default is RGB then depth in [-1, 1],
    (h, w) = `input_size`. `trunk` maps it to the features of the last convolution after its
    activation (B, F, fh, fw), on which heatmaps are computed. `embed` pools them to
    (B, embedding_size), `head` returns the raw output (B, K), which an `OutputConvention` decodes.

    A subclass sets `architecture`, `convention` (its default) and `embedding_size`, and
    implements `trunk`, `embed` and `head`. If `has_features` is False, there is no feature map and
    heatmaps are unavailable. `torch.fx.symbolic_trace` must be able to trace `trunk`; occlusion is
    fast if every operation up to its last convolution is local.
    """

    architecture: ClassVar[str]
    convention: OutputConvention
    input_size: tuple[int, int]
    embedding_size: int
    has_features: bool = True

    @property
    def contract(self) -> InputContract:
        """How images become x, unless a model overrides it."""
        return InputContract(size=self.input_size)

    @property
    def trunk(self) -> nn.Module:
        raise NotImplementedError(f"{type(self).__name__}.trunk")

    @property
    def early(self) -> nn.Module | None:
        """First convolution and activation, (B, C, h, w) -> (B, C', eh, ew); None if unknown."""
        return None

    @property
    def average_pool(self) -> nn.AdaptiveAvgPool2d | None:
        """The layer whose flattened output `embed` returns, where it does nothing else."""
        return None

    def embed(self, features: Tensor) -> Tensor:
        """(B, C, fh, fw) -> (B, embedding_size)."""
        raise NotImplementedError(f"{type(self).__name__}.embed")

    def head(self, embedding: Tensor) -> Tensor:
        """(B, embedding_size) -> (B, K)."""
        raise NotImplementedError(f"{type(self).__name__}.head")

    def forward(self, x: Tensor) -> Tensor:
        return self.head(self.embed(self.trunk(x)))

    def centre_output(self, centre: tuple[float, float], spread: float) -> None:
        """Initialise the output before training to `centre` with deviation `spread`, metres.

        The default does nothing.
        """


@dataclass(frozen=True, slots=True, eq=False)
class LoadedModel:
    """A network in evaluation mode with its convention; `sha256` is that of its weights file.

    `registered` is the input contract in the index, None for a network outside of a store.
    """

    name: str
    architecture: str
    network: PoseNetwork
    convention: OutputConvention
    sha256: str
    registered: InputContract | None = None

    @property
    def contract(self) -> InputContract:
        """How images become the input of the network."""
        return self.registered or self.network.contract
