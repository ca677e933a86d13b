"""Identity: no change; the control that every method has to beat."""

from __future__ import annotations

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


class IdentityTranslator(Translator):
    """Returns its input."""

    method = "identity"

    def translate(self, rgb: Rgb) -> Rgb:
        return rgb

    def tensors(self) -> Tensors:
        return {}

    @classmethod
    def restore(cls, tensors: Tensors, settings: Settings) -> IdentityTranslator:
        return cls()


def fit(source: ImageSet, target: ImageSet, settings: FitSettings) -> FitResult:
    """No statistics are needed."""
    check_images("identity", (), source, target, settings)
    return FitResult(IdentityTranslator())


METHOD = TranslationMethod("identity", "no change, the control", IdentityTranslator, fit)
