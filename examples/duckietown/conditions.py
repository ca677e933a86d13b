"""Lights and cameras as image formation: from the albedo of a scene to an 8-bit camera image.

In linear light: albedo x colour of the lamp x exposure x fall-off x shadows + glare, then blur, the
camera's white balance, shot and read noise, and the curve of the camera. Registry: `CONDITIONS`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.translation.image_set import Rgb

Floats = NDArray[np.float32]
Colour = tuple[float, float, float]

_JITTER = 0.06
"""Spread of lamp colour and exposure between recordings of one condition."""


@dataclass(frozen=True, slots=True)
class Condition:
    """A light and a camera.

    `lamp` and `balance` multiply linear RGB; with `second_lamp`, the colour changes from `lamp` on
    one side of the image to `second_lamp` on the other; `exposure` is a factor; `vignette` and
    `slope` are the shares of light lost in the corners and towards one side; `shadows` is a number
    of shadows that each take `shadow_depth` of the light; `glare` is the light that is added around
    one bright spot; `haze` is light added everywhere; `blur` is a standard deviation in pixels of
    an image 640 pixels wide; `noise` is the standard deviation of the read noise in linear units,
    and a fifth of it scales the shot noise; `gamma` is applied after the sRGB curve.
    """

    name: str
    description: str
    lamp: Colour = (1.0, 1.0, 1.0)
    second_lamp: Colour | None = None
    balance: Colour = (1.0, 1.0, 1.0)
    exposure: float = 1.0
    vignette: float = 0.1
    slope: float = 0.0
    shadows: int = 0
    shadow_depth: float = 0.5
    glare: float = 0.0
    haze: float = 0.0
    blur: float = 0.6
    noise: float = 0.002
    gamma: float = 1.0


CONDITIONS: dict[str, Condition] = {
    condition.name: condition
    for condition in (
        Condition("day", "neutral light"),
        Condition("bright", "overexposed", exposure=1.9, haze=0.01),
        Condition("dark", "a quarter of the light and noise", exposure=0.22, noise=0.006,
                  vignette=0.35, blur=1.0),
        Condition("night", "a tenth of the light, noise and a slope", exposure=0.1, noise=0.008,
                  vignette=0.4, slope=0.4, blur=1.4),
        Condition("warm", "incandescent lamp", lamp=(1.25, 0.85, 0.42), exposure=0.8),
        Condition("cold", "blue sky", lamp=(0.62, 0.9, 1.5), exposure=0.8),
        Condition("green", "fluorescent lamp", lamp=(0.7, 1.15, 0.6), exposure=0.7, slope=0.2),
        Condition("coloured", "strongly blue lamp, dark", lamp=(0.28, 0.45, 1.6), exposure=0.5,
                  noise=0.004, slope=0.3),
        Condition("reddish", "strongly red lamp, dark", lamp=(1.5, 0.5, 0.4), exposure=0.45,
                  noise=0.004, slope=0.3),
        Condition("mixed", "warm lamp on one side, blue lamp on the other", exposure=0.5,
                  lamp=(1.3, 0.8, 0.35), second_lamp=(0.4, 0.7, 1.5), noise=0.004),
        Condition("violet", "violet lamp in the dark, contrast raised", lamp=(0.7, 0.12, 1.3),
                  exposure=0.35, noise=0.006, slope=0.5, vignette=0.35, gamma=1.3),
        Condition("shadows", "deep shadows", shadows=3, shadow_depth=0.65),
        Condition("glare", "low sun with a reflection", glare=0.8, haze=0.02, lamp=(1.1, 1.0, 0.85),
                  slope=0.3),
        Condition("balance", "wrong white balance", balance=(0.7, 1.0, 1.45)),
    )
}  # fmt: skip


def find_condition(name: str) -> Condition:
    """A condition by name. Raises RequestError for unknown names."""
    if name not in CONDITIONS:
        raise RequestError(f"condition {name!r}: one of {', '.join(CONDITIONS)}")
    return CONDITIONS[name]


def varied(condition: Condition, rng: np.random.Generator) -> Condition:
    """The condition with lamp and exposure varied a little, as in another recording."""
    factors = np.exp(rng.normal(0, _JITTER, 3))
    red, green, blue = (float(value) for value in np.array(condition.lamp) * factors)
    exposure = condition.exposure * float(np.exp(rng.normal(0, 2 * _JITTER)))
    return replace(condition, lamp=(red, green, blue), exposure=exposure)


class LightField:
    """The light of one recording: shadows and slope stay where they are in the image."""

    def __init__(self, condition: Condition, size: tuple[int, int], seed: int) -> None:
        self._rng = np.random.default_rng([seed, 41])
        self.condition = varied(condition, self._rng)
        self._factor = self._light(size)
        self._added = self._glare(size)

    def apply(self, rgb: Rgb) -> Rgb:
        """Camera image (H, W, 3) uint8 of an albedo image (H, W, 3) uint8 of the field's size."""
        of = self.condition
        linear = _DECODED[rgb] * self._factor
        linear += self._added
        sigma = of.blur * rgb.shape[1] / 640
        if sigma > 0.2:
            linear = cv2.GaussianBlur(linear, (0, 0), sigma)
        linear = linear * np.array(of.balance, np.float32)
        if of.noise:
            spread = np.sqrt(of.noise**2 + (of.noise / 5) * np.maximum(linear, 0))
            linear = linear + spread * self._rng.standard_normal(linear.shape, dtype=np.float32)
        encoded = _ENCODED[np.clip(linear * 4095, 0, 4095).astype(np.uint16)]
        if of.gamma == 1.0:
            return np.asarray(encoded)
        curve = np.rint(255 * (np.arange(256) / 255) ** of.gamma).astype(np.uint8)
        return curve[encoded]

    def _light(self, size: tuple[int, int]) -> Floats:
        x, y = _unit_grid(size)
        of = self.condition
        light = 1 - of.vignette * (x * x + y * y) / 2
        angle = self._rng.uniform(0, 2 * np.pi)
        light *= 1 - of.slope * (1 + x * np.cos(angle) + y * np.sin(angle)) / 2
        for _ in range(of.shadows):
            light *= self._shadow(size)
        lamp = np.array(of.lamp)
        if of.second_lamp is not None:
            side = (1 + np.clip(x * np.cos(angle) + y * np.sin(angle), -1, 1))[..., None] / 2
            lamp = lamp * (1 - side) + np.array(of.second_lamp) * side
        return np.asarray(of.exposure * light[..., None] * lamp, np.float32)

    def _shadow(self, size: tuple[int, int]) -> Floats:
        height, width = size
        centre = self._rng.uniform((0, 0), (width, height))
        corners = self._rng.uniform(-0.4, 0.4, (5, 2)) * width
        hull = cv2.convexHull((centre + corners).astype(np.float32)).astype(np.int32)
        shadow = np.zeros(size, dtype=np.float32)
        cv2.fillPoly(shadow, [hull], 1.0)
        shadow = cv2.GaussianBlur(shadow, (0, 0), 0.012 * width)
        return np.asarray(1 - self.condition.shadow_depth * shadow)

    def _glare(self, size: tuple[int, int]) -> Floats:
        of = self.condition
        x, y = _unit_grid(size)
        place = self._rng.uniform((-0.7, -0.9), (0.7, 0.3))
        spot = np.exp(-((x - place[0]) ** 2 + ((y - place[1]) * 0.6) ** 2) / 0.12)
        return np.asarray(of.haze + of.glare * spot, np.float32)[..., None] * np.array(
            of.lamp, np.float32
        )


def _unit_grid(size: tuple[int, int]) -> tuple[Floats, Floats]:
    """x and y from -1 to 1, each (H, W)."""
    height, width = size
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    return x.astype(np.float32), y.astype(np.float32)


def _decode(encoded: NDArray[np.floating]) -> Floats:
    """sRGB to linear light, 0 .. 1 (IEC 61966-2-1)."""
    curved = ((encoded + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= 0.04045, encoded / 12.92, curved).astype(np.float32)


def _encode(linear: NDArray[np.floating]) -> Floats:
    """Linear light to sRGB, 0 .. 1 (IEC 61966-2-1)."""
    curved = 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, curved).astype(np.float32)


_DECODED = _decode(np.arange(256) / 255)
_ENCODED = np.rint(255 * _encode(np.arange(4096) / 4095)).astype(np.uint8)
