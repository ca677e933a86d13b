"""Factors of the camera: `exposure` (gain, contrast, vignette) and `camera` (a different mount)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.synthetic_world.factors.factor import Factor, Generator
from s2rtools.synthetic_world.renderer import Camera


@dataclass(frozen=True)
class Exposure(Factor):
    """A random gain per view (mean 0.95, deviation 0.05), flatter contrast, and corners up to 22 %
    darker.
    """

    name = "exposure"
    group = "lighting"
    description = "automatic exposure, flat contrast, vignette"
    gain: float = -0.05
    gain_spread: float = 0.05
    vignette: float = 0.22
    vignette_power: float = 1.5
    flatness: float = 0.07

    def rgb(
        self, rgb: NDArray[np.float32], depth: NDArray[Any], rng: Generator, severity: float
    ) -> NDArray[np.float32]:
        gain = 1 + severity * (self.gain + self.gain_spread * float(rng.standard_normal()))
        height, width = rgb.shape[:2]
        x = (np.arange(width) + 0.5) / width * 2 - 1
        y = (np.arange(height) + 0.5) / height * 2 - 1
        radius = (x[None, :] ** 2 + y[:, None] ** 2) / 2
        vignette = 1 - self.vignette * severity * radius**self.vignette_power
        flat = 1 - self.flatness * severity
        lit = rgb * np.float32(max(gain, 0.2)) * vignette[..., None].astype(np.float32)
        return (lit - 118) * np.float32(flat) + np.float32(118)


@dataclass(frozen=True)
class CameraMount(Factor):
    """The camera sits 9 cm lower and has a 6 % longer focal length than declared."""

    name = "camera"
    group = "camera"
    description = "camera height and field of view"
    height: float = -0.09
    zoom: float = 0.06

    def __post_init__(self) -> None:
        if not self.zoom > -0.4:
            raise RequestError(f"camera.zoom {self.zoom:g}: above -0.4")

    def camera(self, camera: Camera, severity: float) -> Camera:
        return camera.moved(height=self.height * severity, zoom=1 + self.zoom * severity)
