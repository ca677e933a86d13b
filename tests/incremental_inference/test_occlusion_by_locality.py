"""Incremental inference equals full inference, and non-local networks are detected."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from s2rtools.heatmaps import occlusion
from s2rtools.incremental_inference import (
    LocalGraph,
    PixelRegion,
    SlidingWindow,
    cut_patches,
    non_local_reason,
)
from s2rtools.inference import Backend
from s2rtools.inference.batch_norm_folding import fold_batch_norm
from s2rtools.models.pose_network import LoadedModel
from tests.support import networks

# Poses are compared relative to the change that the patches cause.
TOLERANCE = 1e-4


def incremental_and_full(
    model: LoadedModel, patch_indices: list[int] | None = None
) -> tuple[np.ndarray, ...]:
    """Poses (N, P, M, 3) by incremental and by full inference, in both directions."""
    height, width = model.network.input_size
    generator = torch.Generator().manual_seed(1)
    x = torch.rand(2, 4, height, width, generator=generator) * 2 - 1
    other = x.flip(0).contiguous()
    backend = Backend(model)
    patches = cut_patches(height, width)
    if patch_indices is not None:
        patches = [patches[i] for i in patch_indices]
    graph = LocalGraph(backend.trunk)
    with torch.inference_mode():
        before, local = occlusion._recompute_locally(backend, x, other, patches, graph)
        repeated, full = occlusion._recompute_fully(backend, x, other, patches)
    assert np.allclose(before, repeated, atol=1e-5)
    return local, full, before


def assert_equal_results(model: LoadedModel, patch_indices: list[int] | None = None) -> None:
    local, full, before = incremental_and_full(model, patch_indices)
    change = np.abs(full - before[:, None, None]).max()
    assert change > 1e-3
    assert np.abs(local - full).max() <= TOLERANCE * max(change, 1)


@pytest.mark.parametrize("name", list(networks.local_trunks()))
@pytest.mark.parametrize("size", [(37, 45)])
def test_small_trunks_are_computed_incrementally(name, size):
    assert_equal_results(networks.small_model(*networks.local_trunks()[name], size))


def test_resposenet_every_patch_mode_and_direction():
    assert_equal_results(networks.build_model("resposenet"))


def test_posest_corner_edge_and_inner_patches():
    assert_equal_results(networks.build_model("posest"), [0, 3, 5, 14, 21, 35])


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


def test_regions_can_be_united():
    assert PixelRegion(1, 3, 4, 6).union(PixelRegion(2, 8, 0, 5)) == PixelRegion(1, 8, 0, 6)
