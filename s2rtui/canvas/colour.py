"""Colour themes, continuous colour scales, and conversion to 256 and 16 colours.

Colours are uint8 RGB. Scales map numbers to colours; callers handle NaN.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Rgb = tuple[int, int, int]
Pixels = NDArray[np.uint8]


LEAST_CONTRAST = 3.0
"""Contrast ratio of walls to floor and of marks to their ground (WCAG 2.1, criterion 1.4.11)."""
UNSELECTED_CONTRAST = 2.5
"""Contrast ratio of unselected points to their ground, which stay behind the selected ones."""
MARGIN = 1.05
"""Factor of contrast ratios that leaves room for the rounding of colours."""


@dataclass(frozen=True, slots=True)
class Theme:
    """One set of colours; every plot is drawn on `background`.

    The remaining fields keep marks on a map legible; luminances are those of WCAG 2, 0 .. 1.
    wall: colour of the walls of a floor plan. floor: luminances of its darkest and lightest floor.
    mark: luminance that every coloured glyph reaches (on light themes: does not exceed).
    """

    name: str
    background: Rgb
    text: Rgb
    muted: Rgb
    faint: Rgb
    highlight: Rgb
    sim: Rgb
    real: Rgb
    both: Rgb
    truth: Rgb
    unselected: Rgb
    cursor: Rgb
    planned: Rgb
    wall: Rgb
    floor: tuple[float, float]
    mark: float

    @property
    def dark(self) -> bool:
        return sum(self.background) < 3 * 128


DARK = Theme(
    name="dark",
    background=(16, 20, 28),
    text=(226, 232, 240),
    muted=(142, 154, 172),
    faint=(58, 68, 84),
    highlight=(34, 44, 62),
    sim=(92, 160, 255),
    real=(255, 102, 94),
    both=(206, 122, 255),
    truth=(255, 204, 77),
    unselected=(140, 150, 166),
    cursor=(255, 255, 255),
    planned=(92, 214, 146),
    wall=(192, 200, 214),
    floor=(0.016, 0.12),
    mark=0.30,
)
LIGHT = Theme(
    name="light",
    background=(250, 250, 248),
    text=(28, 33, 42),
    muted=(98, 106, 120),
    faint=(206, 210, 217),
    highlight=(226, 233, 245),
    sim=(29, 95, 206),
    real=(208, 44, 48),
    both=(132, 40, 190),
    truth=(154, 105, 0),
    unselected=(128, 136, 150),
    cursor=(0, 0, 0),
    planned=(0, 118, 70),
    wall=(70, 76, 88),
    floor=(0.48, 0.93),
    mark=0.172,
)
THEMES = {theme.name: theme for theme in (DARK, LIGHT)}

NEGATIVE: Rgb = (0, 176, 255)
POSITIVE: Rgb = (255, 122, 0)
NO_DEPTH: Rgb = (84, 44, 68)
DEPTH_SHADES = 255
"""Shades of depth in true pixels: with `NO_DEPTH` they fill a palette of 256 colours."""

_TURBO = (
    "30123b 392a73 4040a1 4456c7 466be3 467ff6 4293ff 37a7fa 29bbec 1dcdd8 18dcc3 1ee8b0 31f299 "
    "4cf97e 6bfd64 8aff4d a3fd3c b8f735 cced34 dee037 edd03a f8c03a fdae35 fe982c fb8022 f56817 "
    "ec520f e04009 d23105 c02302 ac1701 950d01 7a0403"
)


@lru_cache(1)
def turbo_table() -> Pixels:
    """(256, 3): the turbo map (A. Mikhailov, 2019), interpolated between 33 samples."""
    samples = np.array([[int(word[i : i + 2], 16) for i in (0, 2, 4)] for word in _TURBO.split()])
    at, places = np.linspace(0, 1, 256), np.linspace(0, 1, len(samples))
    channels = [np.interp(at, places, samples[:, channel]) for channel in range(3)]
    return np.rint(np.stack(channels, axis=1)).astype(np.uint8)


def turbo(values: ArrayLike) -> Pixels:
    """Map numbers 0 .. 1 (clipped; NaN counts as 0) of any shape to colours (..., 3)."""
    fraction = np.nan_to_num(np.asarray(values, dtype=np.float64), nan=0.0, posinf=1.0, neginf=0.0)
    return turbo_table()[np.rint(np.clip(fraction, 0, 1) * 255).astype(np.intp)]


def diverging(values: ArrayLike, middle: Rgb = (128, 128, 128)) -> Pixels:
    """Map numbers -1 .. 1 (clipped) of any shape to (..., 3): blue, `middle` at 0, orange."""
    signed = np.clip(np.nan_to_num(np.asarray(values, dtype=np.float64)), -1, 1)[..., None]
    end = np.where(signed < 0, np.array(NEGATIVE), np.array(POSITIVE))
    mixed = np.array(middle) + (end - np.array(middle)) * np.abs(signed)
    return np.rint(mixed).astype(np.uint8)


def depth_tint(values: ArrayLike, shades: int | None = None) -> Pixels:
    """Map depth as fractions of its range (clipped; NaN counts as 1) to greys, near is light.

    `shades` limits the number of different greys.
    """
    share = np.nan_to_num(np.asarray(values, dtype=np.float64), nan=1.0)
    share = np.clip(share, 0, 1)[..., None] ** 0.8
    if shades is not None:
        share = np.rint(share * (shades - 1)) / (shades - 1)
    near, far = np.array([238.0, 242.0, 246.0]), np.array([22.0, 28.0, 44.0])
    return np.rint(near + (far - near) * share).astype(np.uint8)


def mix(under: ArrayLike, over: ArrayLike, alpha: ArrayLike) -> Pixels:
    """Blend `over` onto `under` with opacity `alpha` (broadcast over the last axis)."""
    low = np.asarray(under, dtype=np.float32)
    opacity = np.asarray(alpha, dtype=np.float32)
    if opacity.ndim:
        opacity = opacity[..., None]
    return np.rint(low + (np.asarray(over, dtype=np.float32) - low) * opacity).astype(np.uint8)


def luma(colours: ArrayLike) -> NDArray[np.float32]:
    """Rec. 709 brightness 0 .. 1 of sRGB colours, (..., 3) to (...)."""
    weights = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32) / 255
    return np.asarray(np.asarray(colours, dtype=np.float32) @ weights, dtype=np.float32)


@lru_cache(1)
def _linear_table() -> NDArray[np.float32]:
    """(256,): sRGB levels in linear light (IEC 61966-2-1)."""
    level = np.arange(256) / 255
    linear = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)


def to_linear(colours: Pixels) -> NDArray[np.float32]:
    """Convert sRGB (..., 3) to linear light, 0 .. 1."""
    return _linear_table()[colours]


_STEPS = 1 << 14
"""Steps of linear light, each less than a step of sRGB levels."""


@lru_cache(1)
def _level_table() -> NDArray[np.uint8]:
    """(_STEPS + 1,): the sRGB levels of linear light 0 .. 1."""
    light = np.arange(_STEPS + 1) / _STEPS
    level = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.rint(255 * level).astype(np.uint8)


def from_linear(light: NDArray[np.floating[Any]]) -> Pixels:
    """Convert linear light (..., 3), clipped to 0 .. 1, to sRGB."""
    return _level_table()[(np.clip(light, 0, 1) * _STEPS + 0.5).astype(np.int32)]


_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)


def luminance(colours: ArrayLike) -> NDArray[np.float32]:
    """Relative luminance 0 .. 1 of sRGB colours, (..., 3) to (...), as WCAG 2 defines it."""
    return np.asarray(to_linear(np.asarray(colours, dtype=np.uint8)) @ _LUMINANCE)


def contrast(first: ArrayLike, second: ArrayLike) -> NDArray[np.float32]:
    """Contrast ratio of sRGB colours (..., 3), 1 .. 21, as WCAG 2 defines it."""
    bright, dim = luminance(first), luminance(second)
    high, low = np.maximum(bright, dim), np.minimum(bright, dim)
    return np.asarray((high + 0.05) / (low + 0.05), dtype=np.float32)


def with_luminance(colours: Pixels, least: ArrayLike = 0.0, most: ArrayLike = 1.0) -> Pixels:
    """Bring the luminance of colours (..., 3) between two limits, each a number or (...).

    Colours are scaled in linear light, which keeps their hue; what is still too dark where a
    channel is at its end is mixed with white.
    """
    light = to_linear(colours)
    at = light @ _LUMINANCE
    wanted = np.clip(at, np.asarray(least, np.float32), np.asarray(most, np.float32))
    scale = wanted / np.maximum(at, 1e-9)
    scale = np.where(
        wanted > at, np.minimum(scale, 1 / np.maximum(light.max(axis=-1), 1e-9)), scale
    )
    scale = np.maximum(scale, np.float32(1e-9))
    light, at = light * scale[..., None], at * scale
    white = np.clip((wanted - at) / np.maximum(1 - at, 1e-9), 0, 1)[..., None]
    changed = from_linear(light + (1 - light) * white)
    kept = (colours.astype(np.int16) - changed > 1) | (changed.astype(np.int16) - colours > 1)
    return np.where(kept.any(axis=-1, keepdims=True), changed, colours)


def legible(colours: Pixels, theme: Theme) -> Pixels:
    """Colours of glyphs with a contrast of 3:1 to the page and to dim floor (see `Theme`)."""
    if theme.dark:
        return with_luminance(colours, least=theme.mark)
    return with_luminance(colours, most=theme.mark)


_CUBE = np.array([0, 95, 135, 175, 215, 255])
_CUBE_OF = np.abs(np.arange(256)[:, None] - _CUBE[None, :]).argmin(axis=1)
_GREY_OF = np.clip(np.rint((np.arange(256) - 8) / 10), 0, 23).astype(np.intp)


def to_256(colours: Pixels) -> NDArray[np.intp]:
    """Convert (..., 3) to xterm-256 indices 16 .. 255, from the colour cube or the grey ramp."""
    wide = colours.astype(np.intp)
    cube = _CUBE_OF[wide]
    grey = _GREY_OF[wide.sum(axis=-1) // 3]
    off_cube = np.square(_CUBE[cube] - wide).sum(axis=-1)
    off_grey = np.square((8 + 10 * grey)[..., None] - wide).sum(axis=-1)
    index = 16 + 36 * cube[..., 0] + 6 * cube[..., 1] + cube[..., 2]
    return np.where(off_grey < off_cube, 232 + grey, index)


@lru_cache(1)
def palette_256() -> Pixels:
    """(240, 3): the colours of xterm-256 indices 16 .. 255."""
    cube = np.stack(np.meshgrid(_CUBE, _CUBE, _CUBE, indexing="ij"), axis=-1).reshape(-1, 3)
    grey = np.repeat(8 + 10 * np.arange(24)[:, None], 3, axis=1)
    return np.concatenate([cube, grey]).astype(np.uint8)


ANSI_16: NDArray[np.intp] = np.array(
    [
        *((0, 0, 0), (170, 0, 0), (0, 170, 0), (170, 120, 0)),
        *((0, 0, 170), (170, 0, 170), (0, 170, 170), (178, 178, 178)),
        *((96, 96, 96), (255, 90, 90), (90, 255, 90), (255, 230, 85)),
        *((90, 140, 255), (255, 90, 255), (90, 255, 255), (255, 255, 255)),
    ],
    dtype=np.intp,
)


@lru_cache(8)
def _ansi_lookup(ground: Rgb | None = None) -> NDArray[np.intp]:
    """(4096,): the nearest ANSI colour of each 4-bit-per-channel colour, by hue first.

    With `ground`, a colour whose contrast to it is at least 3:1 keeps such a contrast.
    """
    steps = np.arange(16) * 17
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    distance = np.square(grid - ANSI_16[None]).sum(axis=-1)
    saturation = np.square(grid.max(axis=-1) - grid.min(axis=-1))
    distance = distance + saturation * (np.ptp(ANSI_16, axis=1) == 0)
    if ground is not None:
        plain = contrast(grid, ground) >= LEAST_CONTRAST
        distance[plain & (contrast(ANSI_16, ground) < LEAST_CONTRAST)] = 1 << 30
    return distance.argmin(axis=1)


def to_16(colours: Pixels, ground: Rgb | None = None) -> NDArray[np.intp]:
    """Convert (..., 3) to ANSI colour numbers 0 .. 15; see `_ansi_lookup` for `ground`."""
    nibbles = colours.astype(np.intp) >> 4
    return _ansi_lookup(ground)[nibbles[..., 0] * 256 + nibbles[..., 1] * 16 + nibbles[..., 2]]


class ColourMode(Enum):
    """The number of colours that a terminal shows."""

    TRUECOLOR = "truecolor"
    PALETTE = "256"
    ANSI = "16"
    NONE = "none"


def glyph_ground(ground: Pixels, ink: Pixels, theme: Theme, mode: ColourMode) -> Pixels:
    """Ground (n, 3) of glyphs, changed no further than their ink (n, 3) needs to stand out.

    It is darkened on dark themes and lightened on light ones. Where the rounding to 256 colours
    leaves too little contrast, the page colour is taken.
    """
    unselected = (ink == np.array(theme.unselected, dtype=np.uint8)).all(axis=-1)
    ratio = np.where(unselected, UNSELECTED_CONTRAST, LEAST_CONTRAST)
    at = luminance(ink) + 0.05
    if theme.dark:
        limited = with_luminance(ground, most=np.maximum(at / (MARGIN * ratio) - 0.05, 0.0))
    else:
        limited = with_luminance(ground, least=np.minimum(at * MARGIN * ratio - 0.05, 1.0))
    if mode is ColourMode.PALETTE:
        rounded = [palette_256()[to_256(colours) - 16] for colours in (limited, ink)]
        limited[contrast(*rounded) < ratio] = theme.background
    return limited
