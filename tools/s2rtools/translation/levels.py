"""Levels: map two percentiles of each channel to those of the target domain, by a linear map.

The lower percentile is the level of the ground, which covers most of a road image; the upper one is
that of the brightest surfaces. Both are taken over the lower part of the images. The map undoes the
exposure, the colour of the light and light that is added everywhere. Source: the white patch of
Land and McCann, "Lightness and retinex theory", 1971, with percentiles in place of the maximum.
"""

from __future__ import annotations

import numpy as np

from s2rstore.errors import RequestError
from s2rtools.translation.colour_statistics import Floats, statistics_option, to_uint8
from s2rtools.translation.image_set import ImageSet, Rgb
from s2rtools.translation.method import (
    FitResult,
    FitSettings,
    Settings,
    Tensors,
    TranslationMethod,
    Translator,
)
from s2rtools.translation.method_options import check_images, number

OPTIONS = ("statistics", "low", "high", "rows")
LOW, HIGH = 40.0, 97.0
"""Percentiles of the ground and of the brightest surfaces."""
ROWS = 0.7
"""Share of the rows, from the bottom, that the percentiles are taken over."""
MIN_RANGE = 4.0
"""Smallest distance of the source's levels that is stretched, in grey levels."""
MIN_IMAGES = 12
_ALWAYS = 10.0
"""Percentile over the images that must be bright, too, where a pixel is bright in almost all."""
_MIN_MOVING = 0.5


def levels(rgb: Rgb, low: float, high: float, rows: float) -> Floats:
    """(2, 3) grey levels of two percentiles over the lower rows of images (B, H, W, 3).

    Pixels that are bright in almost all of at least `MIN_IMAGES` images are left out: parts of the
    robot and reflections of its lamps.
    """
    start = rgb.shape[1] - max(1, round(rgb.shape[1] * rows))
    lower = rgb[:, start:]
    found = np.percentile(lower.reshape(-1, 3), [low, high], axis=0)
    if len(rgb) < MIN_IMAGES:
        return found
    always = np.percentile(lower, _ALWAYS, axis=0)
    moving = (always <= found.mean(axis=0)).all(axis=2)
    if moving.mean() < _MIN_MOVING:
        return found
    return np.percentile(lower[:, moving].reshape(-1, 3), [low, high], axis=0)


class LevelsTranslator(Translator):
    """`target` (2, 3) are the levels of the target; so is `source`, or it is None where the levels
    of each image are used. `percentiles` are the lower one, the upper one and the share of rows."""

    method = "levels"

    def __init__(
        self, target: Floats, source: Floats | None, percentiles: tuple[float, float, float]
    ) -> None:
        self.target, self.source, self.percentiles = target, source, percentiles

    def translate(self, rgb: Rgb) -> Rgb:
        if self.source is not None:
            return self._mapped(rgb, self.source)
        return np.stack(
            [self._mapped(image, levels(image[None], *self.percentiles)) for image in rgb]
        )

    def _mapped(self, rgb: Rgb, source: Floats) -> Rgb:
        gain = (self.target[1] - self.target[0]) / np.maximum(source[1] - source[0], MIN_RANGE)
        offset = self.target[0] - source[0] * gain
        return to_uint8(rgb * gain.astype(np.float32) + offset.astype(np.float32))

    def tensors(self) -> Tensors:
        source = {} if self.source is None else {"source": self.source}
        return {"target": self.target, **source}

    def settings(self) -> Settings:
        low, high, rows = self.percentiles
        return {"low": low, "high": high, "rows": rows}

    @classmethod
    def restore(cls, tensors: Tensors, settings: Settings) -> LevelsTranslator:
        source = tensors["source"].reshape(2, 3) if "source" in tensors else None
        low, high, rows = (settings[name] for name in ("low", "high", "rows"))
        if not all(type(value) in (int, float) for value in (low, high, rows)):
            raise ValueError(f"percentiles {low}, {high} of {rows}: must be numbers")
        if not (0 <= low < high <= 100 and 0 < rows <= 1):
            raise ValueError(f"percentiles {low}, {high} of {rows}: out of range")
        return cls(tensors["target"].reshape(2, 3), source, (low, high, rows))


def fit(source: ImageSet, target: ImageSet, settings: FitSettings) -> FitResult:
    """Levels of both domains; the options `low` and `high` are percentiles, `rows` a share."""
    check_images("levels", OPTIONS, source, target, settings)
    low = number(settings.options, "low", LOW, 0, 100)
    high = number(settings.options, "high", HIGH, 0, 100)
    rows = number(settings.options, "rows", ROWS, 0.001, 1)
    if low >= high:
        raise RequestError(f"low={low:g}: must be below high={high:g}")
    of_image = statistics_option(settings.options) == "image"
    source_levels = None if of_image else levels(source.images, low, high, rows)
    target_levels = levels(target.images, low, high, rows)
    return FitResult(LevelsTranslator(target_levels, source_levels, (low, high, rows)))


METHOD = TranslationMethod(
    "levels",
    "two percentiles of each channel",
    LevelsTranslator,
    fit,
    options=OPTIONS,
)
