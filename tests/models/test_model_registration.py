"""Weights files: accepted formats, rejected files, and storage in a store."""

import hashlib
import os
import struct
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch import nn

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rtools.models import build_network
from s2rtools.models.conventions import OutputConvention
from s2rtools.models.load_model import load_model
from s2rtools.models.model_registration import pack_weights, read_weights, register_model
from s2rtools.models.pose_network import PoseNetwork


def network_state(architecture: str = "resposenet") -> tuple[PoseNetwork, dict[str, torch.Tensor]]:
    torch.manual_seed(5)
    network = build_network(architecture).eval()
    return network, {key: value.clone() for key, value in network.state_dict().items()}


class Tiny(nn.Module):
    """A network without known layers that returns a tuple, as the paper's network does."""

    input_size = (8, 8)

    def __init__(self) -> None:
        super().__init__()
        self.linear = nn.Linear(256, 3)

    def forward(self, x):
        return self.linear(x.flatten(1)), 0


class TouchesFile:
    """Creates a file when it is unpickled without restrictions."""

    def __init__(self, path: str) -> None:
        self.path = path

    def __reduce__(self):
        return os.mknod, (self.path,)


def register_and_load(store: Path, weights, convention, trust=False):
    with edit(store) as draft:
        register_model(store, draft, "added", weights, convention)
    with s2rstore.open(store) as opened:
        return load_model(opened, "added", trust)


WRAPPINGS = {
    "plain": lambda state: state,
    "model": lambda state: {"model": state, "optimizer": {}},
    "both": lambda state: {"epoch": 3, "state_dict": {f"module.{k}": v for k, v in state.items()}},
    "old": lambda state: {k: v for k, v in state.items() if not k.endswith("batches_tracked")},
}


@pytest.mark.parametrize("wrapping", list(WRAPPINGS))
def test_wrapped_state_dicts_are_loaded(store_copy, tmp_path, wrapping):
    network, state = network_state()
    file = tmp_path / "model.pth"
    torch.save(WRAPPINGS[wrapping](state), file)
    weights = read_weights(file, "resposenet")
    loaded = register_and_load(store_copy, weights, network.convention)
    assert loaded.sha256 == hashlib.sha256(file.read_bytes()).hexdigest()
    assert not loaded.network.training
    x = torch.rand(1, 4, 128, 128)
    with torch.inference_mode():
        torch.testing.assert_close(loaded.network(x), network(x), rtol=0, atol=0)


def test_safetensors_are_loaded(store_copy, tmp_path):
    network, state = network_state("posest")
    save_file(state, tmp_path / "model.safetensors")
    weights = read_weights(tmp_path / "model.safetensors", "posest")
    loaded = register_and_load(store_copy, weights, network.convention)
    torch.testing.assert_close(loaded.network.state_dict(), state, rtol=0, atol=0)


def test_a_pickle_with_code_is_rejected_without_running_it(tmp_path):
    file, created_file = tmp_path / "bad.pth", tmp_path / "ran"
    torch.save({"state_dict": TouchesFile(str(created_file))}, file)
    with pytest.raises(RequestError, match=r"bad\.pth: .*mknod.*refused"):
        read_weights(file, "posest", trust=True)
    assert not created_file.exists()


@pytest.mark.parametrize(
    "content", [None, b"", b"no tensors", b"PK\x03\x04 broken", struct.pack("<Q", 1 << 60) + b"{}"]
)
@pytest.mark.parametrize("suffix", [".pth", ".safetensors"])
def test_damaged_files_are_rejected_by_name(tmp_path, content, suffix):
    file = tmp_path / f"broken{suffix}"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(RequestError, match="broken"):
        read_weights(file, "posest")


def test_wrong_keys_and_shapes_are_named(tmp_path):
    _, state = network_state("posest")
    file = tmp_path / "m.pth"
    cases = {
        "fc3.bias": {k: v for k, v in state.items() if k != "fc3.bias"},
        "extra.weight": {**state, "extra.weight": torch.zeros(1)},
        "fc1.weight": {**state, "fc1.weight": torch.zeros(256, 16384)},
        "not finite": {**state, "fc3.bias": torch.full((3,), float("nan"))},
    }
    for message, invalid_state in cases.items():
        torch.save(invalid_state, file)
        with pytest.raises(RequestError, match=message):
            read_weights(file, "posest")


def test_torchscript_needs_trust_and_then_runs_without_features(store_copy, tmp_path):
    file = tmp_path / "script.pt"
    network, _ = network_state("posest")
    torch.jit.trace(network, torch.zeros(1, 4, 256, 256)).save(str(file))
    with pytest.raises(RequestError, match="--trust"):
        read_weights(file, "torchscript")
    weights = read_weights(file, "torchscript", trust=True)
    loaded = register_and_load(store_copy, weights, OutputConvention("degrees"), trust=True)
    x = torch.rand(1, 4, 256, 256)
    assert not loaded.network.has_features
    with torch.inference_mode():
        torch.testing.assert_close(loaded.network(x), network(x))
    with s2rstore.open(store_copy) as store, pytest.raises(RequestError, match="--trust"):
        load_model(store, "added")


def test_factories_need_trust_and_load_their_state_dict(store_copy, tmp_path):
    module, file = Tiny(), tmp_path / "tiny.pth"
    torch.save(module.state_dict(), file)
    factory = f"{__name__}:Tiny"
    with pytest.raises(RequestError, match="--trust"):
        read_weights(file, factory)
    weights = read_weights(file, factory, trust=True)
    assert weights.contract.size == (8, 8)
    loaded = register_and_load(store_copy, weights, OutputConvention("radians"), trust=True)
    x = torch.rand(2, 4, 8, 8)
    with torch.inference_mode():
        torch.testing.assert_close(loaded.network(x), module(x)[0])


def test_a_convention_with_another_output_width_is_rejected(store_copy):
    network, _ = network_state("posest")
    with pytest.raises(RequestError, match="3"):
        register_and_load(store_copy, pack_weights(network), OutputConvention("cos_sin"))


def test_unknown_architectures_list_the_known_ones(tmp_path):
    torch.save({}, tmp_path / "m.pth")
    with pytest.raises(RequestError, match="posest, resposenet"):
        read_weights(tmp_path / "m.pth", "resnet")


class Opaque(torch.nn.Module):
    """Takes RGB images of 8 x 8 and returns 4 numbers."""

    def __init__(self) -> None:
        super().__init__()
        self.layer = torch.nn.Linear(4 * 64, 4)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.layer(x.flatten(1))


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("kind", ["torchscript", "torch.export", "state dict"])
def test_a_file_of_another_kind_is_recognised(tmp_path, kind):
    file, module, x = tmp_path / "m.pt", Opaque().eval(), torch.zeros(1, 4, 8, 8)
    if kind == "torchscript":
        torch.jit.trace(module, x).save(str(file))
    elif kind == "torch.export":
        torch.export.save(torch.export.export(module, (x,)), file)
    else:
        torch.save(module.state_dict(), file)
    for architecture in {"torchscript", "torch.export", "posest"} - {kind}:
        if kind == "state dict" and architecture == "posest":
            continue
        with pytest.raises(RequestError) as error:
            read_weights(file, architecture, trust=True)
        expected = (
            "name its architecture: --arch posest" if kind == "state dict" else f"--arch {kind}"
        )
        assert expected in str(error.value)
