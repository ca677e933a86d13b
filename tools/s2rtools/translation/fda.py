"""Fourier domain adaptation: the target's mean amplitude at the lowest spatial frequencies.

The phase, which holds the layout of the scene, stays. Source: Yang and Soatto, "FDA: Fourier domain
adaptation for semantic segmentation", 2020; here the amplitude is the mean over the target's images
in place of one random image, so that a translator is a fixed map.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rtools.translation.colour_statistics import Floats, to_uint8
from s2rtools.translation.image_set import ImageSet, Rgb
from s2rtools.translation.method import (
    FitResult,
    FitSettings,
    Option,
    Options,
    Settings,
    Tensors,
    TranslationMethod,
    Translator,
)


def _window(height: int, width: int, reach: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the frequencies -reach .. reach in the layout of `numpy.fft.fft2`."""
    steps = np.arange(-reach, reach + 1)
    rows, columns = np.meshgrid(steps % height, steps % width, indexing="ij")
    return rows, columns


class FdaTranslator(Translator):
    """`amplitude` (2 r + 1, 2 r + 1, 3) is the target's mean amplitude per pixel at the frequencies
    -r .. r of rows and columns."""

    method = "fda"

    def __init__(self, amplitude: Floats) -> None:
        self.amplitude = amplitude

    def apply(self, rgb: Rgb) -> Rgb:
        height, width = rgb.shape[1:3]
        reach = min(len(self.amplitude) // 2, (min(height, width) - 1) // 2)
        inner = len(self.amplitude) // 2 - reach
        amplitude = self.amplitude[inner : inner + 2 * reach + 1, inner : inner + 2 * reach + 1]
        window = _window(height, width, reach)
        translated = np.empty_like(rgb)
        for index, image in enumerate(rgb):
            spectrum = np.fft.fft2(image.astype(np.float64), axes=(0, 1))
            low = spectrum[window]
            phase = low / np.maximum(np.abs(low), 1e-9)
            spectrum[window] = phase * amplitude * height * width
            translated[index] = to_uint8(np.fft.ifft2(spectrum, axes=(0, 1)).real)
        return translated

    def tensors(self) -> Tensors:
        return {"amplitude": self.amplitude}

    @classmethod
    def restore(cls, tensors: Tensors, settings: Settings) -> FdaTranslator:
        amplitude = tensors["amplitude"]
        edge = len(amplitude) if amplitude.ndim == 3 else 0
        if amplitude.shape != (edge, edge, 3) or edge % 2 == 0:
            raise ValueError(f"amplitude of shape {amplitude.shape}")
        return cls(amplitude)


def fit(source: ImageSet, target: ImageSet, settings: FitSettings, options: Options) -> FitResult:
    """Mean amplitude of the target; the option `beta` is the half width of the replaced window as
    a share of the shorter edge."""
    height, width = target.size
    reach = min(max(1, int(options["beta"] * min(height, width))), (min(height, width) - 1) // 2)
    window = _window(height, width, reach)
    total = np.zeros((2 * reach + 1, 2 * reach + 1, 3))
    for image in target.images:
        total += np.abs(np.fft.fft2(image.astype(np.float64), axes=(0, 1))[window])
    return FitResult(FdaTranslator(total / (len(target) * height * width)))


METHOD = TranslationMethod(
    "fda", "amplitude of the lowest spatial frequencies", FdaTranslator, fit,
    options={"beta": Option(0.02, 0.001, 0.5)},  # the paper's middle setting
)  # fmt: skip
