"""The built-in architectures: names, shapes and an independent forward pass."""

import pytest
import torch
from torch import Tensor, fx
from torch.nn import functional as F

from s2rtools.models import ARCHITECTURES, build_network

CONVOLUTIONS = {0: (4, 16), 4: (16, 32), 8: (32, 64), 11: (64, 128), 15: (128, 256),
                18: (256, 512), 22: (512, 256)}  # fmt: skip
POOLED = (0, 4, 11, 18)


def published_state() -> dict[str, Tensor]:
    """Random weights under the names and shapes of the paper's checkpoints."""
    generator = torch.Generator().manual_seed(3)

    def draw(*shape: int) -> Tensor:
        return torch.randn(shape, generator=generator)

    state = {}
    for index, (inputs, outputs) in CONVOLUTIONS.items():
        conv, norm = f"conv_head.{index}", f"conv_head.{index + 1}"
        state[f"{conv}.weight"] = draw(outputs, inputs, 3, 3) / (3 * inputs**0.5)
        state[f"{conv}.bias"] = draw(outputs) * 0.1
        state[f"{norm}.weight"] = 1 + 0.2 * draw(outputs)
        state[f"{norm}.bias"] = 0.2 * draw(outputs)
        state[f"{norm}.running_mean"] = 0.1 * draw(outputs)
        state[f"{norm}.running_var"] = 0.5 + draw(outputs).abs()
        state[f"{norm}.num_batches_tracked"] = torch.tensor(7)
    state |= {"fc1.weight": draw(256, 4096) / 64, "fc1.bias": draw(256),
              "fc3.weight": draw(3, 256) / 16, "fc3.bias": draw(3)}  # fmt: skip
    return state


def functional_posest(state: dict[str, Tensor], x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Features, embedding and output, computed with functions only."""
    for index in CONVOLUTIONS:
        conv, norm = f"conv_head.{index}", f"conv_head.{index + 1}"
        x = F.conv2d(x, state[f"{conv}.weight"], state[f"{conv}.bias"], padding=1)
        deviation = (state[f"{norm}.running_var"] + 1e-5).sqrt()
        gain = (state[f"{norm}.weight"] / deviation)[:, None, None]
        x = (x - state[f"{norm}.running_mean"][:, None, None]) * gain
        x = (x + state[f"{norm}.bias"][:, None, None]).relu()
        if index in POOLED:
            x = F.max_pool2d(x, 2)
    pooled = x.unflatten(2, (4, 4)).unflatten(4, (4, 4)).mean(dim=(3, 5)).flatten(1)
    hidden = F.linear(pooled, state["fc1.weight"], state["fc1.bias"]).relu()
    return x, pooled, F.linear(hidden, state["fc3.weight"], state["fc3.bias"])


def test_posest_loads_published_names_and_computes_the_published_network():
    network = build_network("posest").eval()
    state = published_state()
    network.load_state_dict(state, strict=True)
    assert set(network.state_dict()) == set(state)
    x = torch.rand(2, 4, 256, 256, generator=torch.Generator().manual_seed(1)) * 2 - 1
    with torch.inference_mode():
        features, pooled, output = functional_posest(state, x)
        torch.testing.assert_close(network.trunk(x), features, rtol=1e-4, atol=1e-4)
        embedding = network.embed(network.trunk(x))
        torch.testing.assert_close(embedding, pooled, rtol=1e-4, atol=1e-4)
        torch.testing.assert_close(network(x), output, rtol=1e-4, atol=1e-4)
    assert features.shape == (2, 256, 16, 16)
    assert embedding.shape == (2, 4096)


@pytest.mark.parametrize("architecture", list(ARCHITECTURES))
def test_the_forward_pass_consists_of_trunk_embedding_and_head(architecture):
    network = build_network(architecture).eval()
    x = torch.rand(2, 4, *network.input_size) * 2 - 1
    with torch.inference_mode():
        embedding = network.embed(network.trunk(x))
        torch.testing.assert_close(network.head(embedding), network(x))
    assert embedding.shape == (2, network.embedding_size)
    assert network(x).shape == (2, network.convention.width)


@pytest.mark.parametrize("architecture", list(ARCHITECTURES))
def test_networks_can_be_traced(architecture):
    network = build_network(architecture).eval()
    x = torch.rand(1, 4, *network.input_size)
    with torch.inference_mode():
        torch.testing.assert_close(fx.symbolic_trace(network)(x), network(x))
        torch.testing.assert_close(fx.symbolic_trace(network.trunk)(x), network.trunk(x))


@pytest.mark.parametrize("architecture", list(ARCHITECTURES))
def test_centred_outputs_are_near_the_centre(architecture):
    network = build_network(architecture).eval()
    x = torch.rand(8, 4, *network.input_size) * 2 - 1
    network.centre_output((40.0, -30.0), 5.0)
    with torch.inference_mode():
        poses = network.convention.decode(network(x))
    assert (poses[:, :2] - torch.tensor([40.0, -30.0])).abs().max() < 10
