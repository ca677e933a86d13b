"""Incremental inference equals full inference, and non-local networks are detected."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rtools.heatmaps import occlusion
from s2rtools.incremental_inference import (
    SlidingWindow,
    cut_patches,
    non_local_reason,
)
from s2rtools.inference.trunk_rewriting import fold_batch_norm
from tests.support import networks


@pytest.mark.parametrize("name", list(networks.nonlocal_trunks()))
def test_non_local_trunks_are_detected(name):
    model = networks.small_model(*networks.nonlocal_trunks()[name], (24, 24))
    reason = non_local_reason(fold_batch_norm(model.network.trunk))
    assert reason
    assert occlusion.Occlusion().attributes(model) == {"method": f"in full: {reason}"}


@given(st.integers(6, 300), st.integers(6, 300), st.integers(1, 6))
def test_patches_cover_the_image_once(height, width, count):
    coverage = np.zeros((height, width), int)
    for r in cut_patches(height, width, count):
        coverage[r.r0 : r.r1, r.c0 : r.c1] += 1
    assert (coverage == 1).all()


@given(
    st.integers(1, 5), st.integers(1, 3), st.integers(0, 2), st.integers(8, 30), st.data(),
)  # fmt: skip
def test_affected_outputs_are_exact(extent, stride, padding, size, data):
    window = SlidingWindow(extent, stride, min(padding, extent // 2))
    start = data.draw(st.integers(0, size - 1))
    stop = data.draw(st.integers(start + 1, size))
    affected = []
    for output in range(window.output_size(size)):
        first = output * stride - window.padding
        if first < stop and first + extent > start:
            affected.append(output)
    low, high = window.affected_outputs(start, stop, size)
    if affected:
        assert (low, high) == (affected[0], affected[-1] + 1)
    else:
        assert low == high
