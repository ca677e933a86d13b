"""The kernel inception distance compared with torchmetrics."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torchmetrics.image.kid import poly_mmd

from s2rtools.gap.visual import kid


@given(st.integers(0, 10_000), st.integers(2, 40), st.integers(1, 30))
def test_the_distance_equals_torchmetrics(seed, n, d):
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(n, d)), rng.normal(0.4, 1.2, size=(n, d))
    expected = float(poly_mmd(torch.from_numpy(x), torch.from_numpy(y)))
    assert kid.kernel_distance(x, y) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_the_distance_is_unbiased_for_any_sample_size():
    rng = np.random.default_rng(1)
    for n in (5, 40):
        distances = [kid.kernel_distance(*rng.normal(size=(2, n, 8))) for _ in range(600)]
        assert np.mean(distances) == pytest.approx(0, abs=4 * np.std(distances) / np.sqrt(600))


def test_a_single_image_is_rejected():
    with pytest.raises(ValueError, match="2 samples"):
        kid.kernel_distance(np.zeros((1, 3)), np.zeros((5, 3)))
