"""Weights in and out of a store: loaded without executing anything, unless it is trusted."""

from __future__ import annotations

import hashlib
import importlib
import io
import pickle
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load as load_safetensors
from safetensors.torch import save as save_safetensors
from torch import Tensor, nn

from s2rstore import layout, safe_files
from s2rstore.errors import RequestError
from s2rstore.input_files import check_regular, read_bytes
from s2rstore.ledger import Ledger
from s2rstore.memory_limit import bounded_memory
from s2rstore.reader import Store
from s2rstore.writer import Draft
from s2rtools.models import ARCHITECTURES, build
from s2rtools.models.contract import LoadedModel, OutputConvention, PoseNetwork
from s2rtools.models.opaque import TORCHSCRIPT, OpaqueNetwork
from s2rtools.models.weights_file import (
    MOST_OPAQUE,
    check_archive,
    check_tensors,
    most_bytes,
    parameter_bytes,
    read_weights_file,
)

DEFAULT_CONVENTIONS = {name: network.convention for name, network in ARCHITECTURES.items()}
_WRAPPERS = ("state_dict", "model", "model_state_dict", "net")
_UNPICKLING = 64 << 20
"""Bytes that unpickling may take beside the tensors."""
# What torch's reader raises, beside its own errors, on bytes that are no file of tensors.
_JUNK = (ValueError, TypeError, LookupError, AttributeError, AssertionError, struct.error)


@dataclass(frozen=True, slots=True)
class Weights:
    """A checked weights file, ready to be stored; `content` is what the store keeps.

    `sha256` is the given file's, `outputs` the number of columns of the network's raw output.
    """

    architecture: str
    sha256: str
    content: bytes
    suffix: str
    input_size: tuple[int, int]
    outputs: int


def read_weights(path: Path, architecture: str, trust: bool = False) -> Weights:
    """Check a weights file against an architecture.

    State dicts (.pt, .pth) are read with `weights_only=True`, .safetensors as they are;
    architecture `torchscript` and `module:factory` execute code and need `trust`. Raises
    RequestError naming the file where it does not fit.
    """
    if architecture == TORCHSCRIPT:
        _need_trust(trust, "TorchScript")
        content = read_bytes(path, MOST_OPAQUE)
        digest = hashlib.sha256(content).hexdigest()
        network: PoseNetwork = OpaqueNetwork.from_torchscript(content, str(path))
        outputs = network.embedding_size
        return Weights(architecture, digest, content, ".torchscript", network.input_size, outputs)
    check_regular(path)
    network = _empty_network(architecture, trust)
    content = read_weights_file(path, _most_bytes(network))
    digest = hashlib.sha256(content).hexdigest()
    state = read_state(path, content)
    _load(network, state, str(path))
    packed = pack(network)
    return replace(packed, architecture=architecture, sha256=digest)


def pack(network: PoseNetwork) -> Weights:
    """The weights of a network that was trained here."""
    content = save_safetensors(_plain(_keeper(network).state_dict()))
    digest = hashlib.sha256(content).hexdigest()
    return Weights(
        network.architecture,
        digest,
        content,
        ".safetensors",
        network.input_size,
        network.convention.width,
    )


def _most_bytes(network: PoseNetwork) -> int:
    """The maximum size in bytes of a weights file of the network."""
    return most_bytes(parameter_bytes(_keeper(network).state_dict()))


def _keeper(network: PoseNetwork) -> nn.Module:
    """The module whose state dict a weights file holds."""
    return network.inner if isinstance(network, OpaqueNetwork) else network


def register(
    root: Path,
    draft: Draft,
    name: str,
    weights: Weights,
    convention: OutputConvention,
    trained_by: str | None = None,
) -> None:
    """Store weights and list the model in the next generation.

    Raises RequestError where the convention does not fit the network's output.
    """
    if convention.width != weights.outputs:
        raise RequestError(
            f"model {name}: convention {convention.heading} reads {convention.width} outputs, "
            f"the network gives {weights.outputs}; another --convention?"
        )
    file = f"{layout.MODELS}/{weights.sha256}{weights.suffix}"
    safe_files.write(root, file, weights.content)
    Ledger(root).add(f"model:{weights.sha256}", [(file, 1)])
    draft.note_checksums({file: hashlib.sha256(weights.content).hexdigest()})
    draft.insert_row(
        "model",
        {
            "model": layout.checked_name(name, "model"),
            "architecture": weights.architecture,
            "sha256": weights.sha256,
            "input_height": weights.input_size[0],
            "input_width": weights.input_size[1],
            "convention": convention.to_json(),
            "trained_by": trained_by,
        },
    )


def load_model(store: Store, name: str, trust: bool = False) -> LoadedModel:
    """A store's model in evaluation mode. Raises RequestError where it cannot be loaded."""
    if name not in store.models:
        raise RequestError(f"model {name!r}: not in {store.path} (has: {', '.join(store.models)})")
    record = store.models[name]
    if record.architecture == TORCHSCRIPT:
        _need_trust(trust, f"model {name!r} (TorchScript)")
        path, content = _stored_weights(store, record.sha256, MOST_OPAQUE)
        network: PoseNetwork = OpaqueNetwork.from_torchscript(content, str(path))
    else:
        network = _empty_network(record.architecture, trust)
        path, content = _stored_weights(store, record.sha256, _most_bytes(network))
        check_archive(path, content)
        _load(network, read_state(path, content), str(path))
    network.eval().requires_grad_(False)
    convention = OutputConvention.from_json(record.convention)
    return LoadedModel(name, record.architecture, network, convention, record.sha256)


def _stored_weights(store: Store, sha256: str, most: int) -> tuple[Path, bytes]:
    """The path and content of a model's file, which must not be a link."""
    start = f"{layout.MODELS}/{sha256}."
    try:
        lying = safe_files.names(store.path, layout.MODELS)
        found = next((entry.path for entry in lying if entry.path.startswith(start)), None)
        if found is None:
            raise RequestError(f"{store.path / start}*: missing; add the model again")
        return store.path / found, safe_files.read(store.path, found, most)
    except OSError as error:
        reason = safe_files.explained(error)
        where = error.filename or store.path / layout.MODELS
        raise RequestError(f"{where}: cannot be read ({reason})") from error


def _empty_network(architecture: str, trust: bool) -> PoseNetwork:
    if ":" not in architecture:
        return build(architecture)
    _need_trust(trust, architecture)
    module, _, factory = architecture.partition(":")
    try:
        made = getattr(importlib.import_module(module), factory)()
    except (ImportError, AttributeError, ValueError, TypeError) as error:
        known = ", ".join(ARCHITECTURES)
        raise RequestError(f"architecture {architecture}: {error} (built in: {known})") from error
    if isinstance(made, PoseNetwork):
        return made
    if isinstance(made, nn.Module):
        return OpaqueNetwork(made)
    raise RequestError(f"architecture {architecture}: gave {type(made).__name__}, not a module")


def _need_trust(trust: bool, what: str) -> None:
    if not trust:
        raise RequestError(f"{what} executes code when it is loaded; add --trust if you trust it")


def read_state(path: Path, content: bytes) -> dict[str, Tensor]:
    """The tensors of a weights file without running code from it. Raises RequestError."""
    try:
        if path.suffix == ".safetensors":
            loaded: Any = load_safetensors(content)
        else:
            with bounded_memory(2 * len(content) + _UNPICKLING):
                loaded = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise RequestError(f"{path}: {_refusal(str(error))}; save its state_dict()") from error
    except (SafetensorError, RuntimeError, EOFError, MemoryError, *_JUNK) as error:
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise RequestError(f"{path}: no plain state dict ({reason})") from error
    for wrapper in _WRAPPERS:
        if isinstance(loaded, Mapping) and isinstance(loaded.get(wrapper), Mapping):
            loaded = loaded[wrapper]
    if not isinstance(loaded, Mapping) or not all(isinstance(v, Tensor) for v in loaded.values()):
        raise RequestError(f"{path}: no state dict in it (a mapping of names to tensors)")
    return {str(key).removeprefix("module."): value for key, value in loaded.items()}


def _refusal(message: str) -> str:
    """What a pickle wanted, from the words of torch's restricted reader."""
    wanted = re.search(r"GLOBAL ([\w.]+)", message)
    if wanted:
        return f"loading it would run code ({wanted[1]}), which is refused"
    return "no file of tensors that torch can read without running code"


def _load(into: PoseNetwork, state: dict[str, Tensor], where: str) -> None:
    network = _keeper(into)
    wanted = network.state_dict()
    optional = {key for key in wanted if key.endswith("num_batches_tracked")}
    missing = [key for key in wanted if key not in state and key not in optional]
    extra = [key for key in state if key not in wanted]
    shaped = [k for k, v in state.items() if k in wanted and v.shape != wanted[k].shape]
    for what, keys in (("no", missing), ("unknown", extra), ("wrong shape of", shaped)):
        if keys:
            more = f" and {len(keys) - 3} more" if len(keys) > 3 else ""
            raise RequestError(f"{where}: {what} {', '.join(keys[:3])}{more}; another --arch?")
    check_tensors(state, wanted, where)
    broken = [k for k, v in state.items() if v.is_floating_point() and not v.isfinite().all()]
    if broken:
        raise RequestError(f"{where}: {broken[0]} holds values that are not finite")
    network.load_state_dict(state, strict=False)


def _plain(state: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {key: value.detach().cpu().contiguous().clone() for key, value in state.items()}
