"""The residual network: the simulator at first, kept only where it helps."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import torch

from s2rtools.sysid import Identification
from s2rtools.sysid.residual_network import ResidualNetwork
from s2rtools.sysid.residual_training import _stretches, learn
from tests.sysid.conftest import Silent


def test_an_untrained_network_is_the_simulator(plain: Identification) -> None:
    stretches = _stretches(plain.everything, plain.cube)
    correction = ResidualNetwork(stretches, 1)
    np.testing.assert_allclose(
        correction.poses(stretches), stretches.states[:, :, :3], rtol=0, atol=1e-9
    )


def test_it_does_not_help_where_only_noise_is_left(plain: Identification) -> None:
    residual = learn(plain, Silent(), epochs=40)
    assert not residual.accepted
    assert "does not help" in residual.sentence


def test_it_helps_where_the_structure_differs(unequal: Identification) -> None:
    residual = learn(unequal, Silent(), epochs=120)
    assert residual.accepted
    assert residual.error.low > 0
    assert residual.error.fitted[0] < 0.8 * residual.error.untuned[0]


def test_one_held_out_drive_cannot_judge_it(unequal: Identification) -> None:
    residual = learn(unequal, Silent(), epochs=3)
    better = dataclasses.replace(residual.error, low=0.01, fitted=residual.error.untuned)
    assert dataclasses.replace(residual, error=better).accepted
    alone = dataclasses.replace(residual, error=dataclasses.replace(better, drives=1))
    assert not alone.accepted
    assert "needs 2 held-out drives" in alone.sentence


def test_weights_are_safetensors_that_tell_their_inputs(unequal: Identification) -> None:
    from safetensors.torch import load

    one, other = (learn(unequal, Silent(), epochs=3).weights for _ in range(2))
    assert one == other
    tensors = load(one)
    assert all(torch.isfinite(tensor).all() for tensor in tensors.values())
    length = int.from_bytes(one[:8], "little")
    told = json.loads(json.loads(one[8 : 8 + length])["__metadata__"]["description"])
    assert told["step"] == 0.1
    assert "commands" in told["inputs"]
