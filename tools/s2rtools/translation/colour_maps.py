"""Maps of colours: each brings statistics of the source to those of the target domain.

The statistics of the source are those of all images of its domain (`statistics=domain`: one fixed
map, no flicker), or those of the translated image itself (`statistics=image`: the map follows
changes of light, but also what is in view).
"""

from __future__ import annotations

from abc import abstractmethod
from types import MappingProxyType
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.translation.colour_statistics import (
    Floats,
    from_lab,
    linear_map,
    moments,
    to_lab,
    to_uint8,
    transport,
)
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

STATISTICS = {"statistics": Option("domain", choices=("domain", "image"))}
_NONE: Options = MappingProxyType({})
_BLOCK = 16
_GREY_LEVELS = np.arange(256, dtype=np.float64)


class IdentityTranslator(Translator):
    """Returns its input: the control that every method has to beat."""

    method = "identity"

    def apply(self, rgb: Rgb) -> Rgb:
        return rgb

    def tensors(self) -> Tensors:
        return {}

    @classmethod
    def restore(cls, tensors: Tensors, settings: Settings) -> IdentityTranslator:
        return cls()


class ColourMap(Translator):
    """`target` are the statistics of the target, in an array of `shape`; so is `source`, or it is
    None where the statistics of each image are used. `options` are those of the statistics."""

    shape: ClassVar[tuple[int, int]]
    stored_options: ClassVar[tuple[str, ...]] = ()

    def __init__(self, target: Floats, source: Floats | None, options: Options = _NONE) -> None:
        self.target, self.source, self.options = target, source, options

    @classmethod
    def fitted(cls, source: ImageSet, target: ImageSet, options: Options) -> ColourMap:
        """The map between two domains. Raises RequestError for options that contradict."""
        kept = {name: options[name] for name in cls.stored_options}
        try:
            cls.check_options(kept)
        except ValueError as error:
            raise RequestError(f"{cls.method}: {error}") from error
        of_image = options.get("statistics", "image") == "image"
        first = None if of_image else cls.statistics_of_set(source.images, kept)
        return cls(cls.statistics_of_set(target.images, kept), first, kept)

    @classmethod
    def statistics_of_set(cls, images: Rgb, options: Options) -> Floats:
        """Statistics over all images (N, H, W, 3) of a domain."""
        return cls.statistics(images, options)

    @staticmethod
    @abstractmethod
    def statistics(colours: NDArray[Any], options: Options) -> Floats:
        """Statistics over images (B, H, W, 3) in the map's colour space."""

    @abstractmethod
    def mapped(self, colours: NDArray[Any], source: Floats) -> NDArray[Any]:
        """Colours (..., H, W, 3) with the statistics `source` brought to those of the target."""

    @classmethod
    def check_options(cls, options: Options) -> None:
        """Raise ValueError for values that are no `stored_options`."""

    def apply(self, rgb: Rgb) -> Rgb:
        return self.transformed(rgb)

    def transformed(self, colours: NDArray[Any]) -> NDArray[Any]:
        """Images (B, H, W, 3) in the map's colour space after the map."""
        if self.source is not None:
            return self.mapped(colours, self.source)
        return np.stack(
            [self.mapped(image, self.statistics(image[None], self.options)) for image in colours]
        )

    def tensors(self) -> Tensors:
        return {"target": self.target} | ({} if self.source is None else {"source": self.source})

    def settings(self) -> Settings:
        return dict(self.options)

    @classmethod
    def restore(cls, tensors: Tensors, settings: Settings) -> ColourMap:
        options = {name: settings[name] for name in cls.stored_options}
        cls.check_options(options)
        source = tensors["source"].reshape(cls.shape) if "source" in tensors else None
        return cls(tensors["target"].reshape(cls.shape), source, options)


def _affine(colours: NDArray[Any], gain: Floats, offset: Floats) -> NDArray[np.float32]:
    return np.asarray(colours * gain.astype(np.float32) + offset.astype(np.float32))


class GrayworldTranslator(ColourMap):
    """Scales each channel of each image so that its mean becomes that of the target.

    It removes the colour of the light and the exposure, as the anti-instagram filter of Duckietown
    does. Source: Buchsbaum, "A spatial processor model for object colour perception", 1980, with
    the target's mean in place of grey.
    """

    method = "grayworld"
    shape = (1, 3)
    max_gain = 8.0

    @staticmethod
    def statistics(colours: NDArray[Any], options: Options) -> Floats:
        return np.array([cv2.mean(colours.reshape(-1, colours.shape[2], 3))[:3]])

    def mapped(self, colours: NDArray[Any], source: Floats) -> NDArray[Any]:
        gains = np.clip(self.target / np.maximum(source, 1e-3), 1 / self.max_gain, self.max_gain)
        return linear_map(colours, np.diag(gains[0]), 0)


class ReinhardTranslator(ColourMap):
    """Matches mean and standard deviation, the rows of its statistics, of each channel in L*a*b*.

    Source: Reinhard et al., "Color transfer between images", 2001, with CIE L*a*b* in place of
    l-alpha-beta.
    """

    method = "reinhard"
    shape = (2, 3)
    max_gain = 4.0
    floor = 0.5
    """Added to both standard deviations, in units of L*a*b*."""

    @classmethod
    def statistics_of_set(cls, images: Rgb, options: Options) -> Floats:
        """In blocks of bounded memory."""
        sums = np.zeros((2, 3))
        for start in range(0, len(images), _BLOCK):
            pixels = to_lab(images[start : start + _BLOCK]).reshape(-1, 3).astype(np.float64)
            sums += np.stack([pixels.sum(axis=0), np.square(pixels).sum(axis=0)])
        mean, square = sums / images[..., 0].size
        return np.stack([mean, np.sqrt(np.maximum(square - mean**2, 0))])

    @staticmethod
    def statistics(colours: NDArray[Any], options: Options) -> Floats:
        pixels = colours.reshape(-1, 3)
        return np.stack([of(axis=0, dtype=np.float64) for of in (pixels.mean, pixels.std)])

    def mapped(self, colours: NDArray[Any], source: Floats) -> NDArray[Any]:
        ratio = (self.target[1] + self.floor) / (source[1] + self.floor)
        gain = np.clip(ratio, 1 / self.max_gain, self.max_gain)
        return _affine(colours, gain, self.target[0] - source[0] * gain)

    def apply(self, rgb: Rgb) -> Rgb:
        return from_lab(self.transformed(to_lab(rgb)))


class MklTranslator(ColourMap):
    """Monge-Kantorovich linear colour transfer: the optimal transport between Gaussians in RGB.

    Its statistics are those of `moments`; see `transport`.
    """

    method = "mkl"
    shape = (4, 3)

    @staticmethod
    def statistics(colours: NDArray[Any], options: Options) -> Floats:
        return moments(colours)

    def mapped(self, colours: NDArray[Any], source: Floats) -> NDArray[Any]:
        matrix = transport(source, self.target)
        return linear_map(colours, matrix, self.target[0] - matrix @ source[0])

    @classmethod
    def restore(cls, tensors: Tensors, settings: Settings) -> ColourMap:
        restored = super().restore(tensors, settings)
        for of in (restored.target, restored.source):
            if of is not None and not np.allclose(of[1:], of[1:].T):
                raise ValueError("a covariance that is not symmetric")
        return restored


class HistogramTranslator(ColourMap):
    """Histogram matching: a monotone curve per channel.

    Its statistics are, for each channel and grey level, the share of the pixels below the level,
    plus half of those at it.
    """

    method = "histogram"
    shape = (3, 256)

    @staticmethod
    def statistics(colours: NDArray[Any], options: Options) -> Floats:
        shares = np.empty((3, 256))
        for channel in range(3):
            counts = np.bincount(colours[..., channel].ravel(), minlength=256).astype(np.float64)
            shares[channel] = (counts.cumsum() - counts / 2) / max(1.0, counts.sum())
        return shares

    def mapped(self, colours: NDArray[Any], source: Floats) -> NDArray[Any]:
        curves = np.empty((256, 1, 3))
        for channel in range(3):
            rising = self.target[channel] + np.linspace(0, 1e-9, 256)
            curves[:, 0, channel] = np.interp(source[channel], rising, _GREY_LEVELS)
        rows = colours.reshape(-1, colours.shape[-2], 3)
        return np.asarray(cv2.LUT(rows, to_uint8(curves))).reshape(colours.shape)


class LevelsTranslator(ColourMap):
    """Maps two percentiles of each channel, its statistics, to those of the target.

    The lower percentile is the level of the ground, which covers most of a road image; the upper
    one is that of the brightest surfaces. Both are taken over the lowest share `rows` of the rows.
    The map is linear and undoes the exposure, the colour of the light and light that is added
    everywhere. Source: the white patch of Land and McCann, "Lightness and retinex theory", 1971,
    with percentiles in place of the maximum.
    """

    method = "levels"
    shape = (2, 3)
    stored_options = ("low", "high", "rows")
    min_range = 4.0
    """Smallest distance of the source's levels that is stretched, in grey levels."""
    min_images = 12
    """Images from which on pixels are left out that are bright in almost all of them: parts of the
    robot and reflections of its lamps."""
    always = 10.0
    """Percentile over the images that must be bright, too, in such a pixel."""
    min_moving = 0.5

    @staticmethod
    def statistics(colours: NDArray[Any], options: Options) -> Floats:
        own = LevelsTranslator
        percentiles = [options["low"], options["high"]]
        start = colours.shape[1] - max(1, round(colours.shape[1] * options["rows"]))
        lower = colours[:, start:]
        found = np.percentile(lower.reshape(-1, 3), percentiles, axis=0)
        if len(colours) < own.min_images:
            return found
        moving = (np.percentile(lower, own.always, axis=0) <= found.mean(axis=0)).all(axis=2)
        if moving.mean() < own.min_moving:
            return found
        return np.percentile(lower[:, moving].reshape(-1, 3), percentiles, axis=0)

    def mapped(self, colours: NDArray[Any], source: Floats) -> NDArray[Any]:
        spread = np.maximum(source[1] - source[0], self.min_range)
        gain = (self.target[1] - self.target[0]) / spread
        return to_uint8(_affine(colours, gain, self.target[0] - source[0] * gain))

    @classmethod
    def check_options(cls, options: Options) -> None:
        low, high, rows = (options[name] for name in cls.stored_options)
        if not all(type(value) in (int, float) for value in (low, high, rows)):
            raise ValueError(f"low={low}, high={high}, rows={rows}: must be numbers")
        if not (0 <= low < high <= 100 and 0 < rows <= 1):
            raise ValueError(f"low={low:g}, high={high:g}, rows={rows:g}: out of range or order")


def _method(
    kind: type[ColourMap], description: str, options: dict[str, Option]
) -> TranslationMethod:
    def fit(
        source: ImageSet, target: ImageSet, settings: FitSettings, chosen: Options
    ) -> FitResult:
        return FitResult(kind.fitted(source, target, chosen))

    return TranslationMethod(kind.method, description, kind, fit, options=options)


IDENTITY = TranslationMethod(
    "identity", "no change, the control", IdentityTranslator,
    lambda source, target, settings, options: FitResult(IdentityTranslator()),
)  # fmt: skip
GRAYWORLD = _method(GrayworldTranslator, "one gain per channel and image", {})
REINHARD = _method(ReinhardTranslator, "mean and spread of each channel in L*a*b*", STATISTICS)
MKL = _method(MklTranslator, "linear optimal transport of colours (Monge-Kantorovich)", STATISTICS)
HISTOGRAM = _method(HistogramTranslator, "a monotone curve per channel", STATISTICS)
LEVELS = _method(
    LevelsTranslator, "two percentiles of each channel",
    STATISTICS | {
        "low": Option(40.0, 0, 100), "high": Option(97.0, 0, 100), "rows": Option(0.7, 0.001, 1),
    },
)  # fmt: skip
