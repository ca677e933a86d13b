"""Histogram matching: a monotone curve per channel, from the source's histogram to the target's."""

from __future__ import annotations

import cv2
import numpy as np

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
from s2rtools.translation.method_options import check_images

OPTIONS = ("statistics",)
_LEVELS = np.arange(256, dtype=np.float64)


def cumulative(rgb: Rgb) -> Floats:
    """(3, 256) share of the pixels below each grey level, plus half of those at it."""
    shares = np.empty((3, 256))
    for channel in range(3):
        counts = np.bincount(rgb[..., channel].ravel(), minlength=256).astype(np.float64)
        shares[channel] = (counts.cumsum() - counts / 2) / max(1.0, counts.sum())
    return shares


def curves(source: Floats, target: Floats) -> Rgb:
    """(3, 256) grey level of the target at the same share, for each grey level of the source."""
    matched = np.empty((3, 256))
    for channel in range(3):
        rising = target[channel] + np.linspace(0, 1e-9, 256)
        matched[channel] = np.interp(source[channel], rising, _LEVELS)
    return to_uint8(matched)


class HistogramTranslator(Translator):
    """`target` (3, 256) are cumulative shares; so is `source`, or it is None where the histogram of
    each image is used."""

    method = "histogram"

    def __init__(self, target: Floats, source: Floats | None) -> None:
        self.target, self.source = target, source

    def translate(self, rgb: Rgb) -> Rgb:
        if self.source is not None:
            return _looked_up(rgb, curves(self.source, self.target))
        return np.stack(
            [_looked_up(image, curves(cumulative(image), self.target)) for image in rgb]
        )

    def tensors(self) -> Tensors:
        source = {} if self.source is None else {"source": self.source}
        return {"target": self.target, **source}

    @classmethod
    def restore(cls, tensors: Tensors, settings: Settings) -> HistogramTranslator:
        source = tensors["source"].reshape(3, 256) if "source" in tensors else None
        return cls(tensors["target"].reshape(3, 256), source)


def _looked_up(rgb: Rgb, table: Rgb) -> Rgb:
    rows = rgb.reshape(-1, rgb.shape[-2], 3)
    return np.asarray(cv2.LUT(rows, np.ascontiguousarray(table.T)[:, None])).reshape(rgb.shape)


def fit(source: ImageSet, target: ImageSet, settings: FitSettings) -> FitResult:
    """Histograms of both domains."""
    check_images("histogram", OPTIONS, source, target, settings)
    of_image = statistics_option(settings.options) == "image"
    source_shares = None if of_image else cumulative(source.images)
    return FitResult(HistogramTranslator(cumulative(target.images), source_shares))


METHOD = TranslationMethod(
    "histogram", "a monotone curve per channel", HistogramTranslator, fit, options=OPTIONS
)
