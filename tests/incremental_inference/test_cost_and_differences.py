"""Locality and its estimated cost, and recomputation by differences."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import nn

from s2rtools.heatmaps import occlusion
from s2rtools.incremental_inference import (
    DifferenceGraph,
    LocalGraph,
    SlidingWindow,
    cut_patches,
    non_local_reason,
    winograd,
)
from s2rtools.inference import Backend
from s2rtools.inference.trunk_rewriting import fold_batch_norm
from s2rtools.models.pose_network import LoadedModel
from tests.support import networks


def poses_by_differences(
    model: LoadedModel, precision: str, places: list[int] | None = None
) -> tuple[np.ndarray, ...]:
    """Poses (N, P, M, 3) of changed inputs by differences and in full, those of the unchanged.

    `places` are the numbers of the patches, all by default.
    """
    generator = torch.Generator().manual_seed(1)
    x = torch.rand(2, 4, *model.network.input_size, generator=generator) * 2 - 1
    other = x.flip(0).contiguous()
    backend = Backend(model)
    patches = cut_patches(*model.network.input_size)
    if places is not None:
        patches = [patches[place] for place in places]
    graph = DifferenceGraph(LocalGraph(backend.trunk), precision)
    with torch.inference_mode():
        before, changed = occlusion._recompute_differences(backend, x, other, patches, graph)
        repeated, full = occlusion._recompute_fully(backend, x, other, patches)
    assert np.allclose(before, repeated, atol=1e-5)
    return changed, full, before


@pytest.mark.parametrize("name", list(networks.local_trunks()))
@pytest.mark.parametrize("size", [(37, 45)])
def test_differences_in_float32_equal_full_inference(name, size):
    assert_equal_in_full(networks.small_model(*networks.local_trunks()[name], size))


@pytest.mark.parametrize(
    ("architecture", "places"),
    [("resposenet", None), ("posest", [0, 3, 5, 14, 21, 35])],
    ids=["every patch", "corner, edge and inner patches"],
)
def test_differences_of_architectures_equal_full_inference(architecture, places):
    assert_equal_in_full(networks.build_model(architecture), places)


def assert_equal_in_full(model: LoadedModel, places: list[int] | None = None) -> None:
    changed, full, before = poses_by_differences(model, "float32", places)
    effect = np.abs(full - before[:, None, None]).max()
    assert effect > 1e-3
    assert np.abs(changed - full).max() <= 1e-4 * max(effect, 1)


def test_differences_in_bfloat16_have_errors_relative_to_the_effect():
    model = networks.build_model("resposenet")
    changed, full, before = poses_by_differences(model, "bfloat16")
    effect, error = full - before[:, None, None], changed - full
    assert np.sqrt(np.square(error).mean()) <= 0.02 * np.sqrt(np.square(effect).mean())
    assert np.abs(error).max() > 0


def test_the_method_depends_on_the_estimated_cost():
    kind = occlusion.Occlusion()
    assert kind.attributes(networks.build_model("posest")) == {"method": "by locality"}
    wide = nn.Sequential(*(nn.Conv2d(4, 4, 47, padding=23) for _ in range(2)))
    model = networks.small_model(wide, 4, (24, 24))
    assert kind.attributes(model) == {"method": "in full: locality does not save time"}


@pytest.mark.parametrize("tile", winograd.TILES)
@pytest.mark.parametrize("size", [(1, 1), (7, 7), (9, 14)])
def test_winograd_equals_direct_convolution(tile, size):
    generator = torch.Generator().manual_seed(tile)
    weight = torch.randn(24, 16, 3, 3, generator=generator)
    x = torch.randn(5, 16, size[0] + 2, size[1] + 2, generator=generator)
    expected = nn.functional.conv2d(x.double(), weight.double())
    found = winograd.WinogradConvolution(weight)(x, tile)
    assert found.shape == expected.shape
    error = (found - expected).square().mean().sqrt() / expected.std()
    assert error < 1e-4


@pytest.mark.parametrize("name", list(networks.nonlocal_trunks()))
def test_non_local_trunks_are_detected(name):
    model = networks.small_model(*networks.nonlocal_trunks()[name], (24, 24))
    reason = non_local_reason(fold_batch_norm(model.network.trunk))
    assert reason
    assert occlusion.Occlusion().attributes(model) == {"method": f"in full: {reason}"}


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
