"""The kernel distance against torchmetrics and brute force; its permutation test."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torchmetrics.image.kid import poly_mmd

from s2rtools.gap.visual import kernel


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 40), st.integers(1, 30))
def test_it_agrees_with_torchmetrics(seed: int, n: int, d: int) -> None:
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(n, d)), rng.normal(0.4, 1.2, size=(n, d))
    theirs = float(poly_mmd(torch.from_numpy(x), torch.from_numpy(y)))
    assert kernel.kernel_distance(x, y) == pytest.approx(theirs, rel=1e-9, abs=1e-9)


def test_it_is_unbiased_at_every_n() -> None:
    rng = np.random.default_rng(1)
    for n in (5, 40):
        drawn = [kernel.kernel_distance(*rng.normal(size=(2, n, 8))) for _ in range(600)]
        assert np.mean(drawn) == pytest.approx(0, abs=4 * np.std(drawn) / np.sqrt(600))


def test_the_vectorised_permutations_are_those_of_brute_force() -> None:
    rng = np.random.default_rng(2)
    x, y = rng.normal(size=(7, 4)), rng.normal(size=(9, 4))
    pooled = np.concatenate([x, y])
    gram = kernel.polynomial_gram(pooled, pooled)
    np.fill_diagonal(gram, 0)
    labels = rng.permuted(np.repeat([np.arange(16) < 7], 5, axis=0), axis=1)
    found = kernel._labelled(gram, labels.astype(float), 7)
    wanted = [kernel.kernel_distance(pooled[row], pooled[~row]) for row in labels]
    assert np.allclose(found, wanted)


def test_p_values_are_fair_without_a_gap_and_small_with_one() -> None:
    rng = np.random.default_rng(3)
    fair = [kernel.permutation_p(*rng.normal(size=(2, 25, 6)), 99, seed) for seed in range(300)]
    assert np.mean(np.array(fair) <= 0.05) == pytest.approx(0.05, abs=0.04)
    assert np.mean(fair) == pytest.approx(0.5, abs=0.06)
    x = rng.normal(size=(30, 6))
    assert kernel.permutation_p(x, rng.normal(1.0, 1, size=(30, 6)), 199) == 1 / 200
    assert kernel.permutation_p(x, x[::-1].copy(), 99) > 0.9
    assert kernel.permutation_p(np.ones((10, 3)), np.ones((10, 3)), 99) == 1.0


def test_one_image_is_refused() -> None:
    with pytest.raises(ValueError, match="2 samples"):
        kernel.kernel_distance(np.zeros((1, 3)), np.zeros((5, 3)))
