"""Factors of the camera: `exposure` (gain, contrast, vignette) and `camera` (a different mount)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rtools.synthetic_world.factors.factor import Factor, Generator
from s2rtools.synthetic_world.renderer import Camera


class Exposure(Factor):
    """A random gain per view (mean 0.95, deviation 0.05), flatter contrast, and corners up to 22 %
    darker.
    """

    name = "exposure"
    description = "automatic exposure, flat contrast, vignette"

    def rgb(
        self, rgb: NDArray[np.float32], depth: NDArray[Any], rng: Generator, severity: float
    ) -> NDArray[np.float32]:
        gain = 1 + severity * (-0.05 + 0.05 * float(rng.standard_normal()))
        height, width = rgb.shape[:2]
        x = (np.arange(width) + 0.5) / width * 2 - 1
        y = (np.arange(height) + 0.5) / height * 2 - 1
        radius = (x[None, :] ** 2 + y[:, None] ** 2) / 2
        vignette = 1 - 0.22 * severity * radius**1.5
        flat = 1 - 0.07 * severity
        lit = rgb * np.float32(max(gain, 0.2)) * vignette[..., None].astype(np.float32)
        return (lit - 118) * np.float32(flat) + np.float32(118)


class CameraMount(Factor):
    """The camera sits 9 cm lower and has a 6 % longer focal length than declared."""

    name = "camera"
    description = "camera height and field of view"

    def camera(self, camera: Camera, severity: float) -> Camera:
        return camera.moved(height=-0.09 * severity, zoom=1 + 0.06 * severity)
