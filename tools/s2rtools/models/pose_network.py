"""What a pose network is to the rest of the program."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor, nn

from s2rtools.models.conventions import OutputConvention

__all__ = ["LoadedModel", "OutputConvention", "PoseNetwork"]


class PoseNetwork(nn.Module):
    """An image pair in, a pose out, in three steps that can be called one by one.

    Input x is (B, 4, h, w) float32 in [-1, 1], RGB then depth, (h, w) = `input_size`.
    `trunk` maps it to the features of the last convolution after its activation
    (B, C, fh, fw): the place that heatmaps look at. `embed` pools them to (B, embedding_size),
    `head` gives the raw output (B, K), whose meaning is an `OutputConvention`'s.

    A subclass sets `architecture`, `convention` (its default) and `embedding_size`, and gives
    `trunk`, `embed` and `head`. Where `has_features` is False, `trunk` gives no feature map and
    heatmaps are unavailable. `torch.fx.symbolic_trace` must be able to follow `trunk`, and
    whatever comes before its last convolution should be local for occlusion to be fast.
    """

    architecture: ClassVar[str]
    convention: OutputConvention
    input_size: tuple[int, int]
    embedding_size: int
    has_features: bool = True

    @property
    def trunk(self) -> nn.Module:
        raise NotImplementedError(f"{type(self).__name__}.trunk")

    @property
    def early(self) -> nn.Module | None:
        """The first convolution up to its activation, (B, 4, h, w) -> (B, C, eh, ew), if known."""
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
        """Before training: make typical outputs fall around `centre` with deviation `spread`, m.

        Networks that need no such start keep this default, which does nothing.
        """


@dataclass(frozen=True, slots=True, eq=False)
class LoadedModel:
    """A network in evaluation mode and what is known of it; `sha256` is the weights file's."""

    name: str
    architecture: str
    network: PoseNetwork
    convention: OutputConvention
    sha256: str
