"""Estimated cost of locality, and recomputation by differences."""

import numpy as np
import pytest
import torch
from torch import nn

from s2rtools.heatmaps import occlusion
from s2rtools.incremental_inference import (
    DifferenceGraph,
    LocalGraph,
    cut_patches,
    winograd,
)
from s2rtools.inference import Backend
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


def test_differences_of_wide_convolutions_equal_full_inference():
    layers = [
        nn.Conv2d(4, 64, 3, padding=1), nn.ReLU(), nn.MaxPool2d(2),
        nn.Conv2d(64, 128, 3, padding=1), nn.ReLU(), nn.Conv2d(128, 128, 3, padding=1),
    ]  # fmt: skip
    model = networks.small_model(nn.Sequential(*layers), 128, (48, 48))
    assert winograd.WinogradConvolution(layers[3].weight).tile((12, 12)) is not None
    changed, full, before = poses_by_differences(model, "float32")
    effect, error = full - before[:, None, None], changed - full
    assert np.sqrt(np.square(error).mean()) <= 1e-3 * np.sqrt(np.square(effect).mean())
