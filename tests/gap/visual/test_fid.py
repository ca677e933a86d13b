"""Frechet and kernel distances compared with torchmetrics and properties of Gaussians."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torchmetrics.image.fid import FrechetInceptionDistance
from torchmetrics.image.kid import poly_mmd

from s2rtools.gap.visual import feature_distances
from s2rtools.gap.visual.feature_distances import (
    frechet_distance,
    trace_root,
    trace_root_of_samples,
)


def samples(seed: int, n: int, m: int, d: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    mix = rng.normal(size=(d, d)) / np.sqrt(d)
    return rng.normal(size=(n, d)) @ mix, rng.normal(0.3, 1.4, size=(m, d))


class FlattenedImages(torch.nn.Module):
    """Uses flattened images as features."""

    def __init__(self, features: int) -> None:
        super().__init__()
        self.num_features = features

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        return images.flatten(1)


@pytest.mark.parametrize(("n", "m", "d"), [(200, 150, 12), (20, 20, 48), (9, 40, 27)])
def test_the_distance_equals_torchmetrics(n, m, d):
    x, y = samples(3, n, m, d)
    metric = FrechetInceptionDistance(feature=FlattenedImages(d), normalize=True)
    metric.set_dtype(torch.float64)
    for points, real in ((x, True), (y, False)):
        metric.update(torch.from_numpy(points).reshape(len(points), 3, 1, d // 3), real=real)
    assert frechet_distance(x, y) == pytest.approx(float(metric.compute()), rel=1e-4)


@given(st.integers(0, 10_000), st.integers(3, 30), st.integers(2, 30))
def test_both_computations_of_the_trace_root_agree(seed, n, d):
    x, y = samples(seed, n, n, d)
    scale = np.abs(trace_root_of_samples(x, y)) + 1
    # Each eigenvalue that is 0 by rank contributes the root of the rounding error, 1e-8.
    assert trace_root(x.T @ x, y.T @ y) == pytest.approx(
        trace_root_of_samples(x, y), abs=1e-6 * scale * d
    )


def test_a_single_image_is_rejected():
    with pytest.raises(ValueError, match="2 samples"):
        frechet_distance(np.zeros((1, 3)), np.zeros((5, 3)))
    with pytest.raises(ValueError, match="2 samples"):
        feature_distances.kernel_distance(np.zeros((1, 3)), np.zeros((5, 3)))


@given(st.integers(0, 10_000), st.integers(2, 40), st.integers(1, 30))
def test_the_kernel_distance_equals_torchmetrics(seed, n, d):
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(n, d)), rng.normal(0.4, 1.2, size=(n, d))
    expected = float(poly_mmd(torch.from_numpy(x), torch.from_numpy(y)))
    assert feature_distances.kernel_distance(x, y) == pytest.approx(expected, rel=1e-9, abs=1e-9)
