"""Heatmap `pixel_difference`: difference of both images, a baseline that needs no model."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rtools.heatmaps.heatmap_method import (
    HeatArrays,
    ImageHeatmapKind,
    ImagePair,
    OutputSpec,
    Ray,
)
from s2rtools.models.pose_network import LoadedModel

SIZE = 128


class PixelDifference(ImageHeatmapKind):
    """Absolute difference of both images, averaged over areas to 128 x 128.

    Mode `rgb`: mean over channels, after each image is standardised per channel. Mode `depth`: in
    metres where both sides are valid, NaN where a cell has no such pixel.
    """

    name = "pixel_difference"
    params = {"size": SIZE}  # noqa: RUF012
    uses_truth = False

    def outputs(self, model: LoadedModel | None) -> list[OutputSpec]:
        shape, axes = (SIZE, SIZE), ("row", "column")
        return [
            OutputSpec(None, "rgb", shape, axes, "standard deviations", "float16"),
            OutputSpec(None, "depth", shape, axes, "m", "float16"),
        ]

    def compute(self, pair: ImagePair) -> HeatArrays:
        sim, real = pair.sim, pair.real
        rgb = np.stack([
            _small(np.abs(_normalised(a) - _normalised(b)).mean(axis=2, dtype=np.float32))
            for a, b in zip(sim.rgb, real.rgb, strict=True)
        ])  # fmt: skip
        metres = np.abs(
            sim.depth * np.float32(sim.depth_scale) - real.depth * np.float32(real.depth_scale)
        )
        both = (sim.valid & real.valid).astype(np.float32)
        share = np.stack([_small(weight) for weight in both])
        total = np.stack([_small(values) for values in metres * both])
        with np.errstate(invalid="ignore", divide="ignore"):
            depth = np.where(share > 1e-3, total / share, np.nan).astype(np.float32)
        return {(None, "rgb"): rgb, (None, "depth"): depth}

    def ray(self, mode: str | None) -> Ray:
        return "depth" if mode == "depth" else "rgb"


def _small(image: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(cv2.resize(image, (SIZE, SIZE), interpolation=cv2.INTER_AREA))


def _normalised(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    values = image.astype(np.float32)
    return (values - values.mean(axis=(0, 1))) / np.maximum(values.std(axis=(0, 1)), 1.0)
