"""Factors of the sensors: `sensor` (colour noise, blur) and `depth` (a stereo depth camera)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rtools.synthetic_world.factors.factor import Factor, Generator

UNLIMITED_DEPTH = 10.0
"""Metres that the depth camera measures at severity 0."""


@dataclass(frozen=True)
class Sensor(Factor):
    """Blur of 0.45 pixels in a 128-pixel image, up to half as much again along the motion, then
    noise that grows in dark areas.
    """

    name = "sensor"
    group = "sensor"
    description = "colour noise, defocus and motion blur"
    blur: float = 0.45
    noise: float = 3.0
    dark_noise: float = 3.5

    def rgb(
        self, rgb: NDArray[np.float32], depth: NDArray[Any], rng: Generator, severity: float
    ) -> NDArray[np.float32]:
        sigma = severity * self.blur * rgb.shape[1] / 128
        across = sigma * (1 + 0.5 * float(rng.random()))
        soft = cv2.GaussianBlur(rgb, (0, 0), sigmaX=max(across, 0.01), sigmaY=max(sigma, 0.01))
        grain = rng.standard_normal(rgb.shape, dtype=np.float32)
        strength = severity * (self.noise + self.dark_noise * np.exp(-np.clip(soft, 0, 255) / 60.0))
        return np.asarray(soft + grain * strength, dtype=np.float32)


@dataclass(frozen=True)
class DepthSensor(Factor):
    """Error that grows with the square of distance and is smooth over patches, holes at edges and
    in blobs, nothing nearer than 0.35 m or beyond 7 m at severity 1.
    """

    name = "depth"
    group = "depth"
    description = "depth noise, holes and shorter range"
    nearest: float = 0.35
    farthest: float = 7.0
    patch_noise: float = 0.009
    pixel_noise: float = 0.004
    edge_holes: float = 0.7

    def depth(
        self, depth: NDArray[np.float32], rng: Generator, severity: float
    ) -> NDArray[np.float32]:
        height, width = depth.shape
        coarse = rng.standard_normal((height // 6 + 2, width // 6 + 2)).astype(np.float32)
        smooth = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
        fine = rng.standard_normal(depth.shape).astype(np.float32)
        noisy = depth + severity * depth**2 * (self.patch_noise * smooth + self.pixel_noise * fine)
        steep = np.maximum(
            np.abs(cv2.Sobel(depth, cv2.CV_32F, 1, 0)), np.abs(cv2.Sobel(depth, cv2.CV_32F, 0, 1))
        )
        at_edges = (steep > 1.6 / max(severity, 1e-3)) & (rng.random(depth.shape) < self.edge_holes)
        blobs = cv2.resize(
            rng.standard_normal((height // 9 + 2, width // 9 + 2)).astype(np.float32),
            (width, height), interpolation=cv2.INTER_CUBIC,
        )  # fmt: skip
        holes = at_edges | (blobs > 2.5 - 0.5 * severity)
        too_far = depth > UNLIMITED_DEPTH - (UNLIMITED_DEPTH - self.farthest) * severity
        beyond = too_far | (depth < self.nearest * severity)
        return np.where(holes | beyond | (depth <= 0), np.float32(0), noisy).astype(np.float32)
