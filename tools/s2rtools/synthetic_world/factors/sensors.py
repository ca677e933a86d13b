"""Factors of the sensors: `sensor` (colour noise, blur) and `depth` (a stereo depth camera)."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rtools.synthetic_world.factors.factor import Factor, Generator


class Sensor(Factor):
    """Blur of 0.45 pixels in a 128-pixel image, up to half as much again along the motion, then
    noise that grows in dark areas.
    """

    name = "sensor"
    description = "colour noise, defocus and motion blur"

    def rgb(
        self, rgb: NDArray[np.float32], depth: NDArray[Any], rng: Generator, severity: float
    ) -> NDArray[np.float32]:
        sigma = severity * 0.45 * rgb.shape[1] / 128
        across = sigma * (1 + 0.5 * float(rng.random()))
        soft = cv2.GaussianBlur(rgb, (0, 0), sigmaX=max(across, 0.01), sigmaY=max(sigma, 0.01))
        grain = rng.standard_normal(rgb.shape, dtype=np.float32)
        strength = severity * (3.0 + 3.5 * np.exp(-np.clip(soft, 0, 255) / 60.0))
        return np.asarray(soft + grain * strength, dtype=np.float32)


class DepthSensor(Factor):
    """Error that grows with the square of distance and is smooth over patches, holes at edges and
    in blobs, nothing nearer than 0.35 m or beyond 7 m at severity 1.
    """

    name = "depth"
    description = "depth noise, holes and shorter range"

    def depth(
        self, depth: NDArray[np.float32], rng: Generator, severity: float
    ) -> NDArray[np.float32]:
        height, width = depth.shape
        coarse = rng.standard_normal((height // 6 + 2, width // 6 + 2)).astype(np.float32)
        smooth = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
        fine = rng.standard_normal(depth.shape).astype(np.float32)
        noisy = depth + severity * depth**2 * (0.009 * smooth + 0.004 * fine)
        steep = np.maximum(
            np.abs(cv2.Sobel(depth, cv2.CV_32F, 1, 0)), np.abs(cv2.Sobel(depth, cv2.CV_32F, 0, 1))
        )
        at_edges = (steep > 1.6 / max(severity, 1e-3)) & (rng.random(depth.shape) < 0.7)
        blobs = cv2.resize(
            rng.standard_normal((height // 9 + 2, width // 9 + 2)).astype(np.float32),
            (width, height), interpolation=cv2.INTER_CUBIC,
        )  # fmt: skip
        holes = at_edges | (blobs > 2.5 - 0.5 * severity)
        beyond = (depth > 10 - 3 * severity) | (depth < 0.35 * severity)
        return np.where(holes | beyond | (depth <= 0), np.float32(0), noisy).astype(np.float32)
