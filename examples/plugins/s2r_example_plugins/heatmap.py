"""Heatmap `edges`: where sim and real images have different edges."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rtools.heatmaps.heatmap_method import (
    HeatArrays,
    ImageHeatmapKind,
    ImagePair,
    OutputSpec,
)
from s2rtools.models.pose_network import LoadedModel

SIZE = 32


class Edges(ImageHeatmapKind):
    """Absolute difference of the sizes of the grey values' gradients, per pixel of 32 x 32."""

    name = "edges"
    uses_truth = False

    def outputs(self, model: LoadedModel | None) -> list[OutputSpec]:
        return [OutputSpec(None, None, (SIZE, SIZE), ("row", "column"), "grey levels")]

    def compute(self, pair: ImagePair) -> HeatArrays:
        heat = [np.abs(_edges(sim) - _edges(real))
                for sim, real in zip(pair.sim.rgb, pair.real.rgb, strict=True)]  # fmt: skip
        return {(None, None): np.stack(heat)}


def _edges(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    size = np.hypot(cv2.Sobel(grey, -1, 1, 0), cv2.Sobel(grey, -1, 0, 1))
    return np.asarray(cv2.resize(size, (SIZE, SIZE), interpolation=cv2.INTER_AREA))


EDGES = Edges()
