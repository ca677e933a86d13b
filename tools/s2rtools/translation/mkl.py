"""Monge-Kantorovich linear colour transfer: the optimal transport between two Gaussians in RGB.

x -> T (x - m_s) + m_t with T = S^(-1/2) (S^(1/2) C S^(1/2))^(1/2) S^(-1/2), where S and C are the
covariances of source and target. Source: Pitie and Kokaram, "The linear Monge-Kantorovitch linear
colour mapping for example-based colour transfer", 2007.
"""

from __future__ import annotations

import numpy as np

from s2rtools.translation.colour_statistics import (
    VARIANCE_FLOOR,
    Floats,
    Moments,
    linear_map,
    moments,
    statistics_option,
)
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


def transport(source: Moments, target: Moments, floor: float = VARIANCE_FLOOR) -> Floats:
    """Matrix T (3, 3), symmetric and positive definite, with T S T = C.

    `floor` is added to the diagonal of both covariances.
    """
    root = _power(source.covariance + floor * np.eye(3), 0.5)
    inverse = np.linalg.inv(root)
    inner = _power(root @ (target.covariance + floor * np.eye(3)) @ root, 0.5)
    return np.asarray(inverse @ inner @ inverse)


def _power(matrix: Floats, exponent: float) -> Floats:
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    return np.asarray((vectors * np.maximum(values, 1e-12) ** exponent) @ vectors.T)


class MklTranslator(Translator):
    """`target` are the moments of the target; so is `source`, or it is None where the moments of
    each image are used."""

    method = "mkl"

    def __init__(self, target: Moments, source: Moments | None) -> None:
        self.target, self.source = target, source

    def translate(self, rgb: Rgb) -> Rgb:
        if self.source is not None:
            return self._mapped(rgb, self.source)
        return np.stack([self._mapped(image, moments(image)) for image in rgb])

    def _mapped(self, rgb: Rgb, source: Moments) -> Rgb:
        matrix = transport(source, self.target)
        offset = self.target.mean - matrix @ source.mean
        return linear_map(rgb, matrix, offset)

    def tensors(self) -> Tensors:
        named = {"target": self.target} | ({} if self.source is None else {"source": self.source})
        tensors: Tensors = {}
        for name, of in named.items():
            tensors |= {f"{name}/mean": of.mean, f"{name}/covariance": of.covariance}
        return tensors

    @classmethod
    def restore(cls, tensors: Tensors, settings: Settings) -> MklTranslator:
        target, source = (
            Moments(tensors[f"{name}/mean"].reshape(3), tensors[f"{name}/covariance"].reshape(3, 3))
            if f"{name}/mean" in tensors
            else None
            for name in ("target", "source")
        )
        if target is None:
            raise KeyError("target/mean")
        for of in (target, source):
            if of is not None and not np.allclose(of.covariance, of.covariance.T):
                raise ValueError("a covariance that is not symmetric")
        return cls(target, source)


def fit(source: ImageSet, target: ImageSet, settings: FitSettings) -> FitResult:
    """Moments of both domains."""
    check_images("mkl", OPTIONS, source, target, settings)
    of_image = statistics_option(settings.options) == "image"
    source_moments = None if of_image else moments(source.images)
    return FitResult(MklTranslator(moments(target.images), source_moments))


METHOD = TranslationMethod(
    "mkl", "linear optimal transport of colours (Monge-Kantorovich)", MklTranslator, fit,
    options=OPTIONS,
)  # fmt: skip
