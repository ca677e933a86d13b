"""Contract of a translation method: how a translator is fitted, stored and applied."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

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

    @abstractmethod
    def translate(self, rgb: Rgb) -> Rgb:
        """Translate images (B, H, W, 3) uint8 of any size; returns the same shape and type."""

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


@dataclass(frozen=True, slots=True)
class FitSettings:
    """Settings of a fit.

    A learned method ends after `steps` batches if given (the same seed then gives the same
    translator), else after `minutes` if given, else after the method's default number of steps.
    With `paired`, image i of the source shows the scene of image i of the target. With
    `checkpoint`, the state is saved there every few seconds and a later call continues from it.
    `options` are the options of one method, such as `features` of `style`.
    """

    seed: int = 0
    steps: int | None = None
    minutes: float | None = None
    paired: bool = False
    options: Mapping[str, str] = field(default_factory=dict)
    checkpoint: Path | None = None
    report: ReportProgress = lambda fraction, loss, seconds: None


@dataclass(frozen=True, slots=True)
class FitResult:
    """A fitted translator, its training curve (one row per report) and facts for provenance."""

    translator: Translator
    history: list[dict[str, float]] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class TranslationMethod:
    """A method of the registry `translation.METHODS`.

    `fit(source, target, settings)` raises RequestError for unknown options and too few images.
    `uses_pairs`: the fit can use that images of both domains show the same scenes.
    `learned` methods train a network; the others compute statistics and ignore the budget.
    `version` is increased when a change of the code changes the images of a stored translator.
    """

    name: str
    description: str
    translator: type[Translator]
    fit: Callable[[ImageSet, ImageSet, FitSettings], FitResult]
    learned: bool = False
    options: tuple[str, ...] = ()
    version: int = 1
    uses_pairs: bool = False
