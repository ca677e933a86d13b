"""The kernel distance against torchmetrics and its refusal."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torchmetrics.image.kid import poly_mmd

from s2rtools.gap.visual import kid


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 40), st.integers(1, 30))
def test_it_agrees_with_torchmetrics(seed: int, n: int, d: int) -> None:
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(n, d)), rng.normal(0.4, 1.2, size=(n, d))
    theirs = float(poly_mmd(torch.from_numpy(x), torch.from_numpy(y)))
    assert kid.kernel_distance(x, y) == pytest.approx(theirs, rel=1e-9, abs=1e-9)


def test_it_is_unbiased_at_every_n() -> None:
    rng = np.random.default_rng(1)
    for n in (5, 40):
        drawn = [kid.kernel_distance(*rng.normal(size=(2, n, 8))) for _ in range(600)]
        assert np.mean(drawn) == pytest.approx(0, abs=4 * np.std(drawn) / np.sqrt(600))


def test_one_image_is_refused() -> None:
    with pytest.raises(ValueError, match="2 samples"):
        kid.kernel_distance(np.zeros((1, 3)), np.zeros((5, 3)))
