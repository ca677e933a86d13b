"""Factor `sensor`: noise and blur of the colour sensor."""

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
