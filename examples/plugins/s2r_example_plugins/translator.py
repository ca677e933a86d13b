"""Translator `brighter`: adds one number to all colours."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from s2rtools.translation.method import FitResult, Option, TranslationMethod, Translator


class Brighter(Translator):
    """Colours plus `offset` (1,)."""

    method = "brighter"

    def __init__(self, offset: NDArray[np.float64]) -> None:
        self.offset = offset

    def apply(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        return np.clip(rgb.astype(int) + int(self.offset[0]), 0, 255).astype(np.uint8)

    def tensors(self) -> dict[str, NDArray[Any]]:
        return {"offset": self.offset}

    @classmethod
    def restore(cls, tensors: Mapping[str, NDArray[Any]], settings: Mapping[str, Any]) -> Self:
        return cls(tensors["offset"].reshape(1))


def fit(source: Any, target: Any, settings: Any, options: Mapping[str, float]) -> FitResult:
    """The difference of the mean colours of both sets, times `share`."""
    offset = target.images.mean() - source.images.mean()
    return FitResult(Brighter(np.array([options["share"] * offset])))


METHOD = TranslationMethod(
    "brighter", "one offset of all colours", Brighter, fit, options={"share": Option(1.0, 0, 1)}
)
