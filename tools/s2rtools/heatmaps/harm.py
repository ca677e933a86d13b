"""Heatmaps `harm` and `harm_fine`: what the changed content of a real image costs the prediction.

Both compare the real image with its counterfactual: the same view, light and depth sensor, with the
content of the simulated scene.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.records import SIDES
from s2rtools.counterfactual.attribution import integrated_gradients, repair_gains
from s2rtools.counterfactual.counterfactual_inputs import CounterfactualInputs
from s2rtools.heatmaps.heatmap_method import HeatArrays, HeatmapKind, OutputSpec, PairBatch
from s2rtools.models.pose_network import LoadedModel

MAX_SIDE = 128
STAGE = "harm"
"""Name of the stage that makes the counterfactuals of image pairs once for all kinds."""
USUAL_PIXELS = 160 * 160
"""Pixels of a network's input up to which the kinds are computed by default."""
STEPS = 8
"""Images along the path from the counterfactual to the real image."""


class _HarmKind(HeatmapKind):
    """A map over the real image that sums to what its changed content costs; warped to sim, too.

    Planes: position error in metres, heading error in radians, loss. Values > 0 mark content that
    makes the prediction worse, values < 0 content that makes it better. The sum over a region
    estimates by how much the error falls if the region shows the content of the simulated scene.
    It holds for this image and this model.
    """

    aligned = True
    compares_depth = True
    cost = "tens"
    stage = STAGE
    sums_to_metres = True
    version = 3
    planes = ("position", "heading", "loss")
    unit: ClassVar[str] = "m rad loss"

    def is_default(self, model: LoadedModel) -> bool:
        """Networks of larger inputs take a second and more for each pair of images."""
        height, width = model.contract.size
        return height * width <= USUAL_PIXELS

    def outputs(self, model: LoadedModel) -> list[OutputSpec]:
        shape = (len(self.planes), *_map_size(model))
        return [
            OutputSpec(side, None, shape, ("output", "row", "column"), self.unit, "float16")
            for side in SIDES
        ]

    def compute(self, pair: PairBatch) -> HeatArrays:
        maps = [
            self.attribute(pair, inputs, truth)
            for inputs, truth in zip(pair.counterfactuals, pair.real.truth, strict=True)
        ]
        size = _map_size(pair.model)
        real = [_resized(each, size) for each in maps]
        sim = pair.aligned().counterfactuals.in_sim_view(pair.sim, real)
        return {("sim", None): np.stack(sim), ("real", None): np.stack(real)}

    @abstractmethod
    def attribute(
        self, pair: PairBatch, inputs: CounterfactualInputs, truth: NDArray[np.float64]
    ) -> NDArray[np.float32]:
        """Maps (3, rows, columns) of one image, in RGB pixels; `truth` (3,) is its pose."""


class Harm(_HarmKind):
    """The gain of repairing each changed segment: e(real) - e(real with the segment repaired).

    A segment's gain is spread over its pixels in proportion to the square of their change.
    """

    name = "harm"

    def attribute(
        self, pair: PairBatch, inputs: CounterfactualInputs, truth: NDArray[np.float64]
    ) -> NDArray[np.float32]:
        segments, change = inputs.scenes.segments, inputs.scenes.change
        maps = np.zeros((len(self.planes), *segments.shape), dtype=np.float32)
        if inputs.count:
            gains = repair_gains(pair.pose_backend, inputs, truth)
            squares = change * change
            sums = np.bincount(segments.ravel(), squares.ravel(), inputs.count + 1)[1:]
            shares = np.zeros((len(self.planes), inputs.count + 1))
            shares[:, 1:] = (gains / np.maximum(sums, 1e-9)[:, None]).T
            maps[:] = shares[:, segments] * squares
        return maps


class HarmFine(_HarmKind):
    """Integrated gradients of the error along the line from the counterfactual to the real image.

    Heat = sum over channels of (R - C) * mean over k of grad e(C + a_k (R - C)), with
    a_k = (k + 1/2) / K. It also holds what the noise of the sensor costs. Source: Sundararajan,
    Taly and Yan, "Axiomatic attribution for deep networks", 2017.
    """

    name = "harm_fine"
    params = {"steps": STEPS}  # noqa: RUF012

    def attribute(
        self, pair: PairBatch, inputs: CounterfactualInputs, truth: NDArray[np.float64]
    ) -> NDArray[np.float32]:
        return inputs.in_rgb_pixels(integrated_gradients(pair.backend, inputs, truth, STEPS))


def _map_size(model: LoadedModel) -> tuple[int, int]:
    height, width = model.contract.size
    return min(height, MAX_SIDE), min(width, MAX_SIDE)


def _resized(maps: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Maps (3, rows, columns) resampled to `size` so that their sums stay."""
    if maps.shape[1:] == size:
        return maps
    share = maps[0].size / (size[0] * size[1])
    planes = [cv2.resize(plane, size[::-1], interpolation=cv2.INTER_AREA) for plane in maps]
    return np.stack(planes) * np.float32(share)
