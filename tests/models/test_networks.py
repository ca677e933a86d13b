"""The built-in architectures: names, shapes and an independent forward pass."""

import pytest
import torch
from torch import nn

from s2rtools.models import ARCHITECTURES, build_network
from tests.support import networks


def test_posest_loads_published_names_and_computes_the_published_network():
    torch.manual_seed(3)
    published, network = networks.PlainPosEst(), build_network("posest").eval()
    for module in published.modules():
        if isinstance(module, nn.BatchNorm2d):
            nn.init.uniform_(module.weight, 0.8, 1.2)
            nn.init.uniform_(module.bias, -0.2, 0.2)
    x = torch.rand(2, 4, 256, 256) * 2 - 1
    with torch.inference_mode():
        published(x)  # changes the statistics of batch norm
        features = published.eval().conv_head(x)
        network.load_state_dict(published.state_dict(), strict=True)
        torch.testing.assert_close(network.trunk(x), features, rtol=1e-4, atol=1e-4)
        pooled = published.avgpool(features).flatten(1)
        torch.testing.assert_close(network.embed(features), pooled, rtol=1e-4, atol=1e-4)
        torch.testing.assert_close(network(x), published(x), rtol=1e-4, atol=1e-4)
    assert features.shape == (2, 256, 16, 16)
    assert pooled.shape == (2, 4096)


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
def test_centred_outputs_are_near_the_centre(architecture):
    network = build_network(architecture).eval()
    x = torch.rand(8, 4, *network.input_size) * 2 - 1
    network.centre_output((40.0, -30.0), 5.0)
    with torch.inference_mode():
        poses = network.convention.decode(network(x))
    assert (poses[:, :2] - torch.tensor([40.0, -30.0])).abs().max() < 10
