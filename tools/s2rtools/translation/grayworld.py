"""Gray world: scale each channel of each image so that its mean becomes that of the target domain.

A linear map per channel and image, as the anti-instagram filter of Duckietown; it removes the
colour of the light and the exposure. Source: Buchsbaum, "A spatial processor model for object
colour perception", 1980, with the target's mean in place of grey.
"""

from __future__ import annotations

import cv2
import numpy as np

from s2rtools.translation.colour_statistics import Floats, linear_map, moments
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

MAX_GAIN = 8.0


class GrayworldTranslator(Translator):
    """Gains per image; `mean` (3,) is the target's mean colour in grey levels."""

    method = "grayworld"

    def __init__(self, mean: Floats) -> None:
        self.mean = mean

    def translate(self, rgb: Rgb) -> Rgb:
        return np.stack([linear_map(image, np.diag(self._gains(image)), 0) for image in rgb])

    def _gains(self, image: Rgb) -> Floats:
        means = np.array(cv2.mean(image)[:3])
        return np.clip(self.mean / np.maximum(means, 1e-3), 1 / MAX_GAIN, MAX_GAIN)

    def tensors(self) -> Tensors:
        return {"mean": self.mean}

    @classmethod
    def restore(cls, tensors: Tensors, settings: Settings) -> GrayworldTranslator:
        return cls(tensors["mean"].reshape(3))


def fit(source: ImageSet, target: ImageSet, settings: FitSettings) -> FitResult:
    """Mean colour of the target."""
    check_images("grayworld", (), source, target, settings)
    return FitResult(GrayworldTranslator(moments(target.images).mean))


METHOD = TranslationMethod(
    "grayworld",
    "one gain per channel and image",
    GrayworldTranslator,
    fit,
)
