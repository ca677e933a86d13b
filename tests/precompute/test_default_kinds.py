"""Kinds that take long for a model are computed on request."""

from dataclasses import replace

import pytest
import torch

from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtools.models.input_contract import InputContract
from tests.support import networks


@pytest.mark.parametrize(("size", "usual"), [(128, True), (160, True), (256, False)])
def test_harm_is_a_default_for_small_inputs_alone(size, usual):
    trunk = torch.nn.Sequential(torch.nn.Conv2d(4, 4, 3), torch.nn.ReLU())
    model = networks.small_model(trunk, 4, (size, size))
    model = replace(model, registered=InputContract(size=(size, size)))
    for name, kind in HEATMAP_KINDS.items():
        assert kind.is_default(model) == (usual or name not in ("harm", "harm_fine"))
