"""The forward pass that keeps the outputs of all operations, and what goes on from it."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch import nn

from s2rstore.errors import RequestError
from s2rtools.heatmaps import occlusion
from s2rtools.incremental_inference import BasePass, DifferenceGraph, LocalGraph, cut_patches
from s2rtools.incremental_inference.graph import convolve_directly
from s2rtools.inference import Backend, open_backend
from s2rtools.precompute.run_backends import BackendIdentity, RunBackends
from s2rtools.precompute.tasks import network_outputs
from tests.support import networks

TORCH, WINOGRAD = BackendIdentity("torch", "float32"), BackendIdentity("winograd", "float32")


def images(size: tuple[int, int], n: int = 3) -> torch.Tensor:
    return torch.rand(n, 4, *size, generator=torch.Generator().manual_seed(1)) * 2 - 1


@pytest.mark.parametrize("name", list(networks.local_trunks()))
@pytest.mark.parametrize("size", [(37, 45)])
def test_all_outputs_equal_those_of_single_operations(name, size):
    backend = Backend(networks.small_model(*networks.local_trunks()[name], size))
    graph = LocalGraph(backend.trunk)
    x = images(size).contiguous(memory_format=torch.channels_last)
    with torch.inference_mode():
        found, expected = BasePass(graph)(x), graph.compute_base(x, convolve_directly)
    for values, reference in (
        (found.outputs, expected.outputs),
        (found.padded, expected.padded),
        (found.sums, expected.sums),
    ):
        assert values.keys() == reference.keys()
        for key, value in values.items():
            torch.testing.assert_close(value, reference[key], rtol=1e-5, atol=1e-5)


def test_an_image_has_the_same_features_in_every_batch():
    backend = open_backend(networks.build_model("posest"), "winograd")
    x = images(backend.model.contract.size).numpy()
    together = backend.forward_all(x)
    alone = backend.forward_all(x[1:2])
    np.testing.assert_allclose(alone.features, together.features[1:2], rtol=0, atol=1e-6)
    expected = Backend(backend.model).forward_all(x)
    np.testing.assert_allclose(together.pose, expected.pose, rtol=0, atol=1e-4)


@pytest.mark.parametrize("precision", ["float32", "bfloat16-broad"])
def test_changed_poses_are_the_same_with_a_kept_base(precision):
    size = (36, 36)
    model = networks.small_model(*next(iter(networks.local_trunks().values())), size)
    backend = Backend(model)
    graph = DifferenceGraph(LocalGraph(backend.trunk), precision)
    x, patches = images(size), cut_patches(*size)
    given = backend, x, x.flip(0), patches, graph
    with torch.inference_mode():
        base = graph.compute_base(torch.cat([x, x]).contiguous(memory_format=torch.channels_last))
        computed = occlusion._recompute_differences(*given)
        kept = occlusion._recompute_differences(*given, base=base.images(slice(3, 6)))
    for values, expected in zip(kept, computed, strict=True):
        np.testing.assert_allclose(values, expected, rtol=0, atol=1e-5)


def test_trunks_that_are_not_local_are_refused():
    trunk = nn.Sequential(nn.Conv2d(4, 8, 3, padding=1), nn.AdaptiveAvgPool2d(4))
    with pytest.raises(RequestError, match="winograd"):
        open_backend(networks.small_model(trunk, 8, (20, 24)), "winograd")


@pytest.mark.parametrize(
    ("backends", "joined"),
    [
        (RunBackends(WINOGRAD, WINOGRAD, "float32"), True),
        (RunBackends(WINOGRAD, TORCH, "float32"), False),
        (RunBackends(TORCH, TORCH, "float32"), False),
    ],
)
def test_occlusion_goes_on_from_a_pass_that_keeps_its_outputs(backends, joined):
    keys = SimpleNamespace(prediction=lambda *given: "a" * 16,
                           heatmap=lambda *given: ("b" * 16, False))  # fmt: skip
    run, iids = SimpleNamespace(run="r"), range(600)
    forward, others = network_outputs.network_stages(
        keys, run, iids, networks.build_model("posest"), backends, ["occlusion"]
    )  # type: ignore[arg-type]
    assert any(spec.kind == "occlusion" for spec in forward.specs) == joined
    assert [stage.name for stage in others] == ([] if joined else ["occlusion"])
