"""Interface of heatmap kinds: their input batches and their outputs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from s2rstore.errors import RequestError
from s2rtools.counterfactual.counterfactual_inputs import CounterfactualInputs
from s2rtools.heatmaps.harmonization import HarmonisedPair, ImageAlignment
from s2rtools.incremental_inference import BaseOutputs
from s2rtools.inference import Backend
from s2rtools.models.pose_network import LoadedModel

Ray = Literal["rgb", "depth"]
Cost = Literal["forward", "tens", "hundreds"]
"""Forward passes of the network per pair: that of the predictions, or tens or hundreds more."""
HeatArrays = dict[tuple[str | None, str | None], NDArray[Any]]
"""Arrays (B, *shape) of a heatmap kind by side and mode."""


@dataclass(frozen=True, slots=True, eq=False)
class SideImages:
    """The images of one side of a batch of B pairs, at the stored size.

    rgb (B, H, W, 3) uint8, depth (B, H, W) raw and valid (B, H, W).
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[Any]
    valid: NDArray[np.bool_]
    depth_scale: float


@dataclass(frozen=True, slots=True, eq=False)
class SideBatch(SideImages):
    """The images of one side of a batch of B pairs, and what the network made of them.

    x (B, C, h, w) tensor, the network's input; features (B, F, fh, fw) and embedding (B, D)
    tensors; prediction and truth (B, 3) in metres, metres, radians; base, the outputs of all
    operations of the trunk, where the backend keeps them.
    """

    x: Tensor
    features: Tensor | None
    embedding: Tensor
    prediction: NDArray[np.float64]
    truth: NDArray[np.float64]
    base: BaseOutputs | None = None


class ImagePair:
    """The images of both sides of a batch; `alignment` for kinds that need it."""

    sim: SideImages
    real: SideImages
    alignment: ImageAlignment | None

    def aligned(self) -> ImageAlignment:
        """The rigs of both sides. Raises RequestError if they are not calibrated."""
        if self.alignment is None:
            raise RequestError(
                "the two rigs are not calibrated; harmonised heatmaps are unavailable"
            )
        return self.alignment

    @cached_property
    def harmonised(self) -> list[HarmonisedPair]:
        """Each pair harmonised to the sim view; computed once for all kinds."""
        view = self.aligned().sim_view
        sides = (zip(s.rgb, s.depth, s.valid, strict=True) for s in (self.sim, self.real))
        return [view.harmonise(sim, real) for sim, real in zip(*sides, strict=True)]


@dataclass(frozen=True, eq=False)
class ImageBatch(ImagePair):
    """The images of a batch of pairs, without a network."""

    sim: SideImages
    real: SideImages
    alignment: ImageAlignment | None = None


@dataclass(frozen=True, eq=False)
class PairBatch(ImagePair):
    """Both sides of a batch after the forward pass.

    `predictor` computes poses of changed inputs in float32, by default `backend`.
    """

    model: LoadedModel
    backend: Backend
    sim: SideBatch
    real: SideBatch
    alignment: ImageAlignment | None = None
    predictor: Backend | None = None

    @property
    def pose_backend(self) -> Backend:
        """The backend that computes poses of changed inputs."""
        return self.predictor or self.backend

    @cached_property
    def counterfactuals(self) -> list[CounterfactualInputs]:
        """Each real image and its counterfactual as inputs; computed once for all kinds."""
        return self.aligned().counterfactuals.inputs(self.sim, self.real, self.model.contract)

    def composites(self) -> Iterator[NDArray[np.float32]]:
        """The composites (32, C, h, w) of the factors of each pair, one pair at a time."""
        return self.aligned().counterfactuals.composites(self.sim, self.real, self.counterfactuals)

    def side(self, side: str | None) -> SideBatch:
        return self.sim if side == "sim" else self.real

    def features(self, side: str) -> Tensor:
        """Raises RequestError for a network without accessible features."""
        features = self.side(side).features
        if features is None:
            raise RequestError(f"model {self.model.name!r} has no accessible features; no heatmaps")
        return features


@dataclass(frozen=True, slots=True)
class OutputSpec:
    """One array of a heatmap kind; `shape` is that of one instance, without the iid axis."""

    side: str | None
    mode: str | None
    shape: tuple[int, ...]
    axes: tuple[str, ...]
    unit: str
    dtype: str = "float32"


class HeatmapKind(ABC):
    """A heatmap method; its docstring states the formula, the sign and the source.

    `version` changes whenever the values change. Kinds of low `cost` are computed first.
    `planes` names the maps along the first axis of an array with several maps per instance.
    Kinds that need many passes and name the same `stage` are computed together.
    `model_free` kinds need no network, see `ImageHeatmapKind`; `uses_features` tells whether
    `compute` reads the features and predictions of the pair, `uses_truth` whether it reads the true
    poses; `aligned` kinds compare both views by calibrated rigs, and those that `compares_depth`
    know the noise of the depth sensor; `compares_images` tells whether
    the images of a pair are compared position by position, as if both had one pose.
    `surface` selects the depth for the projection on the floor: that of the side, or the nearer.
    `sums_to_metres` tells whether the heat over a region sums to the metres of position error that
    the region costs, in the plane `position` of kinds with planes.
    """

    name: ClassVar[str]
    version: ClassVar[int] = 1
    params: ClassVar[dict[str, Any]] = {}
    cost: ClassVar[Cost] = "forward"
    planes: ClassVar[tuple[str, ...]] = ()
    model_free: ClassVar[bool] = False
    uses_truth: ClassVar[bool] = True
    uses_features: ClassVar[bool] = False
    aligned: ClassVar[bool] = False
    compares_depth: ClassVar[bool] = False
    stage: ClassVar[str | None] = None
    compares_images: ClassVar[bool] = True
    surface: ClassVar[Literal["own", "nearer"]] = "own"
    sums_to_metres: ClassVar[bool] = False

    def suits(self, model: LoadedModel) -> bool:
        """Whether the method can be computed for a model."""
        return self.model_free or model.network.has_features

    def is_default(self, model: LoadedModel) -> bool:
        """Whether the method is computed for a model where no kinds are named."""
        return True

    @abstractmethod
    def outputs(self, model: LoadedModel) -> list[OutputSpec]:
        """The arrays that `compute` fills."""

    def attributes(self, model: LoadedModel, differences: str = "float32") -> dict[str, str]:
        """How the values are computed; stored with each array.

        `differences` is the precision of the differences of the backend, see `Backend`.
        """
        return {}

    def uses_base(self, attributes: Mapping[str, str]) -> bool:
        """Whether `compute`, by what `attributes` state, goes on from the trunk's operations."""
        return False

    @abstractmethod
    def compute(self, pair: PairBatch) -> HeatArrays:
        """The arrays of all outputs for a batch."""

    def ray(self, mode: str | None) -> Ray:
        """The camera whose pixels the map lies on."""
        return "rgb"


class ImageHeatmapKind(HeatmapKind):
    """A heatmap method that needs images alone, so that runs without a network have it, too."""

    model_free = True

    @abstractmethod
    def outputs(self, model: LoadedModel | None) -> list[OutputSpec]:
        """The arrays that `compute` fills, the same for every model."""

    @abstractmethod
    def compute(self, pair: ImagePair) -> HeatArrays:
        """The arrays of all outputs for a batch."""


def feature_size(model: LoadedModel) -> tuple[int, int]:
    """Rows and columns of the trunk's output."""
    device = next(model.network.parameters()).device
    with torch.inference_mode():
        features = model.network.trunk(torch.zeros(1, *model.contract.shape, device=device))
    return int(features.shape[-2]), int(features.shape[-1])
