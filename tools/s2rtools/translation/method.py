"""Contract of a translation method: how a translator is fitted, stored and applied."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.translation.image_set import ImageSet, Rgb

Tensors = dict[str, NDArray[Any]]
Settings = dict[str, Any]
ReportProgress = Callable[[float, float, float], None]
"""Called with the finished fraction, the last loss and the remaining seconds."""


class Translator(ABC):
    """A fitted map from images of a source domain to images that look like a target domain.

    It is stored as `tensors()` and `settings()` and restored by `restore`. The same image always
    gives the same result.
    """

    method: ClassVar[str]
    quick: ClassVar[bool] = True
    """Whether a small image takes milliseconds, so that files are tested on one when read."""
    lower: float = 1.0
    """Share of the rows, from the bottom, that is translated; the others stay as they are."""

    def translate(self, rgb: Rgb) -> Rgb:
        """Translate images (B, H, W, 3) uint8 of any size; returns the same shape and type."""
        start = first_lower_row(rgb.shape[1], self.lower)
        if not start:
            return self.apply(rgb)
        return np.concatenate([rgb[:, :start], self.apply(rgb[:, start:])], axis=1)

    @abstractmethod
    def apply(self, rgb: Rgb) -> Rgb:
        """The map itself, of images (B, H, W, 3) that are translated as a whole."""

    def use_faster_precision(self, rgb: Rgb) -> None:  # noqa: B027
        """Compute in a lower precision from now on where that is faster on images like `rgb`.

        Results may then differ by a grey level. Most methods have one precision.
        """

    @abstractmethod
    def tensors(self) -> Tensors:
        """Arrays that define the translator, by name; finite and of a floating or integer type."""

    def settings(self) -> Settings:
        """JSON values that define the translator, apart from its tensors."""
        return {}

    @classmethod
    @abstractmethod
    def restore(cls, tensors: Tensors, settings: Settings) -> Translator:
        """The translator of `tensors` and `settings`.

        The tensors are finite, of a floating or integer type, in C order. Raises KeyError,
        IndexError, TypeError or ValueError where they do not define a translator.
        """


def blend(rgb: Rgb, translated: Rgb, strength: float) -> Rgb:
    """Image between the original (strength 0) and the translated image (strength 1).

    At strength 0 the original array itself is returned.
    """
    if strength == 0:
        return rgb
    if strength == 1:
        return translated
    mixed = rgb + np.float32(strength) * (translated.astype(np.float32) - rgb)
    return np.clip(np.rint(mixed), 0, 255).astype(np.uint8)


def translate_image(translator: Translator, rgb: Rgb, strength: float) -> Rgb:
    """One image (H, W, 3), translated by a share; at strength 0 the array itself."""
    if strength == 0:
        return rgb
    return np.asarray(blend(rgb[None], translator.translate(rgb[None]), strength)[0])


@dataclass(frozen=True, slots=True)
class Option:
    """An option of a method. The type of `default` is that of its values.

    A number lies in `low` .. `high`; a text is one of `choices`, or any text where there are none.
    """

    default: float | str
    low: float = 0.0
    high: float = math.inf
    choices: tuple[str, ...] = ()

    def parse(self, name: str, text: str) -> float | str:
        """The value of a text. Raises RequestError where it is not one of the option's values."""
        if isinstance(self.default, str):
            if self.choices and text not in self.choices:
                raise RequestError(f"{name}={text}: one of {', '.join(self.choices)}")
            return text
        whole = isinstance(self.default, int)
        try:
            value = int(text) if whole else float(text)
        except ValueError:
            value = math.nan
        if not self.low <= value <= self.high:
            kind = "whole number" if whole else "number"
            raise RequestError(f"{name}={text}: a {kind} from {self.low:g} to {self.high:g}")
        return value


Options = Mapping[str, Any]
"""Values of all options of a method by name."""


@dataclass(frozen=True, slots=True)
class FitSettings:
    """Settings of a fit.

    A learned method ends after `steps` batches if given (the same seed then gives the same
    translator), else after `minutes` if given, else after the method's default number of steps.
    With `paired`, image i of the source shows the scene of image i of the target. With
    `checkpoint`, the state is saved there every few seconds and a later call continues from it.
    `options` are texts of the options of one method, such as `features` of `style`. `lower` is the
    share of the rows, from the bottom, that is fitted and translated.
    """

    seed: int = 0
    steps: int | None = None
    minutes: float | None = None
    paired: bool = False
    options: Mapping[str, str] = field(default_factory=dict)
    checkpoint: Path | None = None
    report: ReportProgress = lambda fraction, loss, seconds: None
    lower: float = 1.0


@dataclass(frozen=True, slots=True)
class FitResult:
    """A fitted translator, its training curve (one row per report) and facts for provenance."""

    translator: Translator
    history: list[dict[str, float]] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class TranslationMethod:
    """A method of the registry `translation.METHODS`.

    `compute(source, target, settings, options)` fits a translator to images that were checked.
    `uses_pairs`: the fit can use that images of both domains show the same scenes.
    `learned` methods train a network on images of one size; the others compute statistics and
    ignore the budget. `version` is increased when a change of the code changes the images of a
    stored translator.
    """

    name: str
    description: str
    translator: type[Translator]
    compute: Callable[[ImageSet, ImageSet, FitSettings, Options], FitResult]
    learned: bool = False
    options: Mapping[str, Option] = field(default_factory=dict)
    version: int = 1
    uses_pairs: bool = False

    def fit(self, source: ImageSet, target: ImageSet, settings: FitSettings) -> FitResult:
        """Fit a translator from images of one domain to the look of another.

        Raises RequestError for unknown options and values, for too few images, and for images and
        pairs that do not match.
        """
        options = self.parse(settings.options)
        for images in (source, target):
            if not len(images):
                raise RequestError(f"{self.name}: no images in {images.name}")
        if self.learned and source.size != target.size:
            raise RequestError(
                f"{self.name}: {source.name} has images of {source.size}, {target.name} of "
                f"{target.size}; read both with the same size"
            )
        if settings.paired and len(source) != len(target):
            raise RequestError(
                f"{self.name}: {len(source)} images in {source.name} and {len(target)} in "
                f"{target.name} are not pairs"
            )
        lowest = [each.from_row(first_lower_row(each.size[0], settings.lower))
                  for each in (source, target)]  # fmt: skip
        result = self.compute(lowest[0], lowest[1], settings, options)
        result.translator.lower = settings.lower
        return result

    def parse(self, texts: Mapping[str, str]) -> Options:
        """Values of all options. Raises RequestError for unknown options and wrong values."""
        for name in texts:
            if name not in self.options:
                known = ", ".join(self.options)
                names = f"one of {known}" if known else "this method has no options"
                raise RequestError(f"{self.name}: option {name!r}: {names}")
        return {
            name: option.parse(name, texts[name]) if name in texts else option.default
            for name, option in self.options.items()
        }


def lower_share(text: str, what: str) -> float:
    """A share of the rows above 0, at most 1. Raises RequestError, beginning with `what`."""
    try:
        share = float(text)
    except ValueError:
        share = math.nan
    if not 0 < share <= 1:
        raise RequestError(f"{what}: lower={text}: a share of the rows above 0, at most 1")
    return share


def first_lower_row(height: int, share: float) -> int:
    """The first of the lowest `share` of the rows of an image; at least one row is in it."""
    return height - max(1, round(height * share))
