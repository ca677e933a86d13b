"""The residual network: initially without effect, accepted only if it improves held-out drives."""

import dataclasses
import json

import numpy as np
import pytest
import torch

from s2rstore.intervals import Interval
from s2rtools.sysid.identify import identify
from s2rtools.sysid.residual_network import CorrectionNetwork, learn, stretches_of
from s2rtools.sysid.synthetic_drives import DriveSettings, make_drives
from tests.support.silent_reporter import SilentReporter
from tests.sysid.conftest import QUICK


def test_an_untrained_network_equals_the_simulator(identified):
    segments = stretches_of(identified.everything, identified.cube)
    correction = CorrectionNetwork(segments, 1)
    np.testing.assert_allclose(
        correction.poses(segments), segments.states[:, :, :3], rtol=0, atol=1e-9
    )


def test_the_network_is_rejected_if_only_noise_remains(identified):
    residual = learn(identified, SilentReporter(), epochs=40)
    assert not residual.accepted
    assert "does not help" in residual.sentence


@pytest.mark.deep
def test_the_network_is_accepted_for_a_structural_mismatch(tmp_path):
    drives = make_drives(tmp_path, 11, {"latency": 0.8, "wheels": 1.0}, DriveSettings(16, 9.5))
    result = identify(drives, dataclasses.replace(QUICK, held_out=6), SilentReporter())
    residual = learn(result, SilentReporter(), epochs=120)
    assert residual.accepted
    assert residual.error.ratio.high < 1
    assert residual.error.fitted[0] < 0.8 * residual.error.untuned[0]


def test_a_single_held_out_drive_is_not_enough(identified_unequal_wheels):
    residual = learn(identified_unequal_wheels, SilentReporter(), epochs=3)
    ratio = Interval(0.8, 0.85, 0.9)
    better = dataclasses.replace(residual.error, ratio=ratio, fitted=residual.error.untuned)
    assert dataclasses.replace(residual, error=better).accepted
    single_drive = dataclasses.replace(residual, error=dataclasses.replace(better, drives=1))
    assert not single_drive.accepted
    assert "needs 2 held-out drives" in single_drive.sentence


def test_weights_are_safetensors_with_a_description_of_inputs(identified_unequal_wheels):
    from safetensors.torch import load

    first, second = (
        learn(identified_unequal_wheels, SilentReporter(), epochs=3).weights for _ in range(2)
    )
    assert first == second
    tensors = load(first)
    assert all(torch.isfinite(tensor).all() for tensor in tensors.values())
    length = int.from_bytes(first[:8], "little")
    description = json.loads(json.loads(first[8 : 8 + length])["__metadata__"]["description"])
    assert description["step"] == 0.1
    assert "commands" in description["inputs"]
