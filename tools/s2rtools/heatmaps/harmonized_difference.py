"""Heatmaps `harmonised_*`: difference of both sides after harmonising the real image to sim."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from s2rstore.records import SIDES
from s2rtools.heatmaps.feature_distance import feature_difference
from s2rtools.heatmaps.harmonization import COLOUR_FLOOR
from s2rtools.heatmaps.heatmap_method import (
    HeatArrays,
    HeatmapKind,
    ImageHeatmapKind,
    ImagePair,
    OutputSpec,
    PairBatch,
)
from s2rtools.models.pose_network import LoadedModel
from s2rtools.models.preprocessing import preprocess

MAX_SIDE = 128
_SHARE = 0.25
"""Share of a cell's pixels that must have a value."""


class _HarmonisedKind(HeatmapKind):
    """A comparison in the view of the sim RGB camera, NaN outside the real camera's view.

    The map is warped to the real side by its depth, NaN where that is unknown. On the floor it is
    projected at the nearer of both surfaces.
    """

    aligned = True
    uses_truth = False
    unit: ClassVar[str]
    params = {"colour_floor": COLOUR_FLOOR, "size": MAX_SIDE, "share": _SHARE}  # noqa: RUF012
    surface = "nearer"

    def _outputs(self, size: tuple[int, int]) -> list[OutputSpec]:
        """The maps of both sides, of `size` rows and columns."""
        return [OutputSpec(side, None, size, ("row", "column"), self.unit, "float16")
                for side in SIDES]  # fmt: skip

    def _maps(
        self,
        distance: NDArray[np.float32],
        known: Sequence[NDArray[np.bool_]],
        pair: ImagePair,
        size: tuple[int, int],
    ) -> HeatArrays:
        """The maps of both sides of `distance` (B, rows, columns), given in the sim view.

        Elsewhere than at the pixels `known` of a pair its distance is undefined.
        """
        sim = []
        for heat, pixels in zip(distance, known, strict=True):
            share = _area_mean(pixels.astype(np.float32), heat.shape)
            sim.append(np.where(share > _SHARE, heat, np.float32(np.nan)))
        view = pair.aligned().real_view
        real = np.stack(
            [_shrink(view.warp_from_other(heat, depth, valid), size)
             for heat, depth, valid in zip(sim, pair.real.depth, pair.real.valid, strict=True)]
        )  # fmt: skip
        return {("sim", None): np.stack([_shrink(heat, size) for heat in sim]),
                ("real", None): real}  # fmt: skip


class HarmonisedDistance(_HarmonisedKind):
    """(1 - cosine) * mean |A_sim - A_real| over the features of the network's first convolution.

    The real image is harmonised to sim: warped through the sim depth by both calibrated rigs, holes
    filled, and per image and channel R <- (R - mean_R) / (std_R + c) * (std_S + c) + mean_S. At
    least 0. It shows changes of the scene independently of the light, not causes of the error.
    Untrained networks give similar maps, because early features are mostly edges and colours.
    """

    name = "harmonised_distance"
    unit = "activation"

    def suits(self, model: LoadedModel) -> bool:
        return model.network.early is not None

    def outputs(self, model: LoadedModel) -> list[OutputSpec]:
        return self._outputs(self._size(model))

    def compute(self, pair: PairBatch) -> HeatArrays:
        known = [harmonised.visible for harmonised in pair.harmonised]
        return self._maps(self._distance(pair), known, pair, self._size(pair.model))

    def _size(self, model: LoadedModel) -> tuple[int, int]:
        with torch.inference_mode():
            shape = _early_features(model, torch.zeros(1, *model.contract.shape)).shape[-2:]
        return min(int(shape[0]), MAX_SIDE), min(int(shape[1]), MAX_SIDE)

    def _distance(self, pair: PairBatch) -> NDArray[np.float32]:
        views, contract = pair.harmonised, pair.model.contract
        images = (
            (np.stack([v.sim for v in views]), np.stack([v.sim_depth for v in views])),
            (np.stack([v.real for v in views]), np.stack([v.real_depth for v in views])),
        )
        sim, real = (preprocess(rgb, depth, 1.0, contract, depth > 0) for rgb, depth in images)
        with torch.inference_mode():
            a, b = (_early_features(pair.model, torch.from_numpy(x)) for x in (sim, real))
            distance = feature_difference(a, b)
        return np.asarray(distance.cpu().numpy(), dtype=np.float32)


class HarmonisedDifference(_HarmonisedKind, ImageHeatmapKind):
    """Model-free baseline sqrt(c d), NaN where either depth is unknown.

    c is the mean |RGB difference| over channels in deviations of the sim image, d the depth
    difference relative to the sim depth; both are means of 3 x 3 pixels.
    """

    name = "harmonised_difference"
    unit = ""

    def outputs(self, model: LoadedModel | None) -> list[OutputSpec]:
        return self._outputs((MAX_SIDE, MAX_SIDE))

    def compute(self, pair: ImagePair) -> HeatArrays:
        known = [harmonised.measured for harmonised in pair.harmonised]
        return self._maps(self._distance(pair), known, pair, (MAX_SIDE, MAX_SIDE))

    def _distance(self, pair: ImagePair) -> NDArray[np.float32]:
        distances = []
        for view in pair.harmonised:
            spread = np.maximum(view.sim.std(axis=(0, 1)), 1.0)
            colour = (np.abs(view.sim - view.real) / spread).mean(axis=2)
            depth = np.abs(view.real_depth - view.sim_depth) / np.maximum(view.sim_depth, 0.1)
            distances.append(np.sqrt(_blur(colour) * _blur(np.where(view.measured, depth, 0.0))))
        return np.stack(distances).astype(np.float32)


def _early_features(model: LoadedModel, x: Tensor) -> Tensor:
    assert model.network.early is not None
    device = next(model.network.parameters()).device
    images = x.to(device).contiguous(memory_format=torch.channels_last)
    features: Tensor = model.network.early(images)
    return features


def _blur(image: NDArray[Any]) -> NDArray[np.float32]:
    """Mean over 3 x 3 pixels, to suppress single noisy pixels."""
    return np.asarray(cv2.blur(image.astype(np.float32), (3, 3)))


def _area_mean(image: NDArray[Any], size: tuple[int, ...]) -> NDArray[Any]:
    return np.asarray(cv2.resize(image, (size[1], size[0]), interpolation=cv2.INTER_AREA))


def _shrink(heat: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Area means of the finite pixels; NaN in cells without enough of them."""
    if heat.shape == size:
        return heat
    known = np.isfinite(heat)
    share = _area_mean(known.astype(np.float32), size)
    total = _area_mean(np.where(known, heat, 0), size)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(share > _SHARE, total / share, np.nan).astype(np.float32)
