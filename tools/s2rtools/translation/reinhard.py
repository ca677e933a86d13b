"""Reinhard: match mean and standard deviation of each channel in L*a*b*.

Source: Reinhard et al., "Color transfer between images", 2001, with CIE L*a*b* in place
of l-alpha-beta.
"""

from __future__ import annotations

import numpy as np

from s2rtools.translation.colour_statistics import Floats, from_lab, statistics_option, to_lab
from s2rtools.translation.image_set import ImageSet, Rgb
from s2rtools.translation.method import (
    FitResult,
    FitSettings,
    Settings,
    Tensors,
    TranslationMethod,
    Translator,
)
from s2rtools.translation.method_options import check_images

OPTIONS = ("statistics",)
MAX_GAIN = 4.0
_BLOCK = 16
_FLOOR = 0.5
"""Added to both standard deviations, in units of L*a*b*."""


class ReinhardTranslator(Translator):
    """`target` (2, 3) holds mean and standard deviation in L*a*b*; so does `source`, or it is None
    where the statistics of each image are used."""

    method = "reinhard"

    def __init__(self, target: Floats, source: Floats | None) -> None:
        self.target, self.source = target, source

    def translate(self, rgb: Rgb) -> Rgb:
        lab = to_lab(rgb)
        if self.source is not None:
            return from_lab(self._matched(lab, self.source))
        return from_lab(np.stack([self._matched(image, _mean_and_std(image)) for image in lab]))

    def _matched(self, lab: np.ndarray, source: Floats) -> np.ndarray:
        gain = np.clip((self.target[1] + _FLOOR) / (source[1] + _FLOOR), 1 / MAX_GAIN, MAX_GAIN)
        offset = self.target[0] - source[0] * gain
        return np.asarray(lab * gain.astype(np.float32) + offset.astype(np.float32))

    def tensors(self) -> Tensors:
        source = {} if self.source is None else {"source": self.source}
        return {"target": self.target, **source}

    @classmethod
    def restore(cls, tensors: Tensors, settings: Settings) -> ReinhardTranslator:
        source = tensors["source"].reshape(2, 3) if "source" in tensors else None
        return cls(tensors["target"].reshape(2, 3), source)


def _mean_and_std(lab: np.ndarray) -> Floats:
    pixels = lab.reshape(-1, 3)
    return np.stack([pixels.mean(axis=0, dtype=np.float64), pixels.std(axis=0, dtype=np.float64)])


def _set_statistics(images: Rgb) -> Floats:
    """Mean and standard deviation (2, 3) over all images, in blocks of bounded memory."""
    sums = np.zeros((2, 3))
    for start in range(0, len(images), _BLOCK):
        pixels = to_lab(images[start : start + _BLOCK]).reshape(-1, 3).astype(np.float64)
        sums += np.stack([pixels.sum(axis=0), np.square(pixels).sum(axis=0)])
    mean, square = sums / images[..., 0].size
    return np.stack([mean, np.sqrt(np.maximum(square - mean**2, 0))])


def fit(source: ImageSet, target: ImageSet, settings: FitSettings) -> FitResult:
    """Mean and standard deviation of both domains."""
    check_images("reinhard", OPTIONS, source, target, settings)
    of_image = statistics_option(settings.options) == "image"
    source_statistics = None if of_image else _set_statistics(source.images)
    return FitResult(ReinhardTranslator(_set_statistics(target.images), source_statistics))


METHOD = TranslationMethod(
    "reinhard", "mean and spread of each channel in L*a*b*", ReinhardTranslator, fit,
    options=OPTIONS,
)  # fmt: skip
