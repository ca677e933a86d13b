"""Inference backends: batch norm folding and reduced precision."""

import ctypes
import importlib.util
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from s2rstore.errors import RequestError
from s2rtools.inference import Backend, calibration, choose_backend, open_backend
from s2rtools.inference.backend import Bfloat16Backend
from s2rtools.inference.trunk_rewriting import fold_batch_norm, split_first_convolution
from s2rtools.models.input_contract import InputContract
from tests.support import networks


def batch(model, n: int = 3) -> np.ndarray:
    rng = np.random.default_rng(0)
    return (rng.random((n, *model.contract.shape)) * 2 - 1).astype(np.float32)


@pytest.mark.parametrize("architecture", ["posest", "resposenet"])
def test_folding_does_not_change_the_outputs(architecture):
    model = networks.build_model(architecture)
    x = batch(model, 2)
    with torch.no_grad():
        expected = model.convention.decode(model.network(torch.from_numpy(x)).double())
    result = Backend(model).forward_all(x)
    assert np.allclose(result.pose, expected.numpy(), atol=1e-4)
    assert result.embedding.shape == (2, model.network.embedding_size)
    names = {type(module).__name__ for module in fold_batch_norm(model.network.trunk).modules()}
    assert "BatchNorm2d" not in names


@pytest.mark.parametrize("name", ["torch-bfloat16", "openvino", "openvino-float32"])
def test_reduced_networks_take_the_channels_of_their_contract(name):
    if name.startswith("openvino") and importlib.util.find_spec("openvino") is None:
        pytest.skip("openvino is not installed")
    trunk = nn.Sequential(nn.Conv2d(3, 8, 3, padding=1), nn.BatchNorm2d(8), nn.ReLU())
    contract = InputContract("rgb", (20, 24))
    model = replace(networks.small_model(trunk, 8, (20, 24)), registered=contract)
    x = batch(model)
    assert x.shape == (3, 3, 20, 24)
    poses = open_backend(model, name).forward_all(x).pose
    np.testing.assert_allclose(poses, Backend(model).forward_all(x).pose, atol=0.05)


def test_openvino_leaves_the_signal_stack_of_this_thread():
    """It would free the stack in the thread that destroys the model, and a signal would crash."""
    pytest.importorskip("openvino")
    before = _signal_stack()
    backend = open_backend(networks.build_model("posest"), "openvino-float32")
    assert _signal_stack() == before
    with ThreadPoolExecutor(1) as executor:
        executor.submit(backend.__dict__.clear).result()
    assert _signal_stack() == before


def _signal_stack() -> bytes:
    """The alternate signal stack of this thread: address, flags and size."""
    stack = ctypes.create_string_buffer(24)
    assert ctypes.CDLL(None).sigaltstack(None, stack) == 0
    return stack.raw


def test_torch_is_float32_and_deterministic():
    model = networks.build_model("resposenet")
    x = batch(model)
    backend = choose_backend(model, x, "torch").backend
    assert (backend.name, backend.precision) == ("torch", "float32")
    assert (backend.forward_all(x).pose == Backend(model).forward_all(x).pose).all()


def test_an_inaccurate_backend_is_rejected(monkeypatch):
    model = networks.build_model("resposenet")
    x = batch(model)
    monkeypatch.setattr(Bfloat16Backend, "features", lambda self, x: Backend.features(self, x) * 2)
    monkeypatch.setattr(Bfloat16Backend, "__init__", Backend.__init__)
    with pytest.raises(RequestError, match="calibration batch"):
        choose_backend(model, x, "torch-bfloat16")


def test_auto_selects_only_accurate_backends():
    model = networks.build_model("resposenet")
    x = batch(model)
    chosen = choose_backend(model, x, "auto")
    reference = Backend(model).forward_all(x).pose
    deviation = np.hypot(*(chosen.backend.forward_all(x).pose - reference)[:, :2].T).max()
    assert deviation <= 0.01
    assert chosen.metres == pytest.approx(deviation, abs=1e-5)


def imitation(label: str, accelerated: bool, factor: float) -> type[Backend]:
    """A backend whose features are off by a factor, on a machine that accelerates it or not."""

    class Imitation(Backend):
        name = label

        @classmethod
        def is_accelerated(cls) -> bool:
            return accelerated

        def features(self, x: torch.Tensor) -> torch.Tensor:
            return super().features(x) * factor

    return Imitation


@pytest.mark.parametrize(
    ("preferred", "expected"),
    [
        ([("first", True, 1.0), ("second", True, 1.0)], "first"),
        ([("absent", False, 1.0), ("second", True, 1.0)], "second"),
        ([("inaccurate", True, 2.0), ("second", True, 1.0)], "second"),
        ([("absent", False, 1.0), ("inaccurate", True, 2.0)], "torch"),
    ],
)
def test_auto_takes_the_first_backend_that_the_machine_has_and_that_is_accurate(
    preferred, expected, monkeypatch
):
    model = networks.build_model("resposenet")
    monkeypatch.setattr(calibration, "PREFERENCE", [imitation(*each) for each in preferred])
    assert choose_backend(model, batch(model), "auto").backend.name == expected


def test_unknown_and_missing_backends_are_named():
    model = networks.build_model("resposenet")
    with pytest.raises(RequestError, match="torch-bfloat16"):
        open_backend(model, "abacus")


@pytest.mark.parametrize("architecture", ["posest", "resposenet"])
def test_a_trunk_is_split_after_its_first_convolution(architecture):
    model = networks.build_model(architecture)
    backend = Backend(model)
    first, rest = backend.split_trunk
    assert isinstance(first, nn.Conv2d)
    x = torch.from_numpy(batch(model, 2))
    with torch.no_grad():
        assert torch.allclose(rest(first(x)), backend.trunk(x), atol=1e-5)


@pytest.mark.parametrize("trunk", [networks.ResidualBlock(4), networks.Branches(), nn.ReLU()])
def test_trunks_whose_input_has_other_readers_stay_whole(trunk):
    folded = fold_batch_norm(trunk)
    first, rest = split_first_convolution(folded)
    assert isinstance(first, nn.Identity)
    assert rest is folded
