"""Read, store and load weights; code in files is executed only if the user trusts them."""

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

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, safe_files
from s2rstore.files.input_files import check_regular, read_bytes
from s2rstore.files.ledger import Ledger
from s2rstore.index.transaction import IndexTransaction
from s2rstore.reader import Store
from s2rstore.security.memory_limit import bounded_memory
from s2rtools.models import ARCHITECTURES, build_network
from s2rtools.models.conventions import parse_convention
from s2rtools.models.pose_network import LoadedModel, OutputConvention, PoseNetwork
from s2rtools.models.torchscript import TORCHSCRIPT, OpaqueNetwork
from s2rtools.models.weights_file import (
    MAX_TORCHSCRIPT_BYTES,
    check_archive,
    check_tensors,
    max_file_bytes,
    parameter_bytes,
    read_weights_file,
)

DEFAULT_CONVENTIONS = {name: network.convention for name, network in ARCHITECTURES.items()}
_WRAPPER_KEYS = ("state_dict", "model", "model_state_dict", "net")
_UNPICKLING_BYTES = 64 << 20
"""Memory for unpickling, in addition to the tensors."""
# Exceptions of torch's reader, besides its own errors, on bytes that are not a tensor file.
_DECODING_ERRORS = (
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    AssertionError,
    struct.error,
)


@dataclass(frozen=True, slots=True)
class Weights:
    """A checked weights file, ready to be stored; `content` is stored.

    `sha256` is that of the original file, `outputs` the width of the network's output.
    """

    architecture: str
    sha256: str
    content: bytes
    suffix: str
    input_size: tuple[int, int]
    outputs: int


def read_weights(path: Path, architecture: str, trust: bool = False) -> Weights:
    """Check a weights file against an architecture.

    State dicts (.pt, .pth) are read with `weights_only=True`; architectures `torchscript` and
    `module:factory` execute code and need `trust`. Raises RequestError naming the file if it does
    not fit.
    """
    if architecture == TORCHSCRIPT:
        _require_trust(trust, "TorchScript")
        content = read_bytes(path, MAX_TORCHSCRIPT_BYTES)
        digest = hashlib.sha256(content).hexdigest()
        network: PoseNetwork = OpaqueNetwork.from_torchscript(content, str(path))
        outputs = network.embedding_size
        return Weights(architecture, digest, content, ".torchscript", network.input_size, outputs)
    check_regular(path)
    network = _untrained_network(architecture, trust)
    content = read_weights_file(path, _max_bytes(network))
    digest = hashlib.sha256(content).hexdigest()
    state = read_state(path, content)
    _load_state(network, state, str(path))
    packed = pack_weights(network)
    return replace(packed, architecture=architecture, sha256=digest)


def pack_weights(network: PoseNetwork) -> Weights:
    """Weights of a network in memory."""
    content = save_safetensors(_cpu_tensors(_stored_module(network).state_dict()))
    digest = hashlib.sha256(content).hexdigest()
    return Weights(
        network.architecture,
        digest,
        content,
        ".safetensors",
        network.input_size,
        network.convention.width,
    )


def _max_bytes(network: PoseNetwork) -> int:
    """The maximum size in bytes of a weights file of the network."""
    return max_file_bytes(parameter_bytes(_stored_module(network).state_dict()))


def _stored_module(network: PoseNetwork) -> nn.Module:
    """The module whose state dict a weights file contains."""
    return network.inner if isinstance(network, OpaqueNetwork) else network


def register_model(
    root: Path,
    draft: IndexTransaction,
    name: str,
    weights: Weights,
    convention: OutputConvention,
    trained_by: str | None = None,
) -> None:
    """Store weights and list the model in the next generation.

    Raises RequestError if the convention does not fit the network's output.
    """
    if convention.width != weights.outputs:
        raise RequestError(
            f"model {name}: convention {convention.heading} reads {convention.width} outputs, "
            f"the network gives {weights.outputs}; another --convention?"
        )
    file = f"{layout.MODELS}/{weights.sha256}{weights.suffix}"
    atomic_writes.write(root, file, weights.content)
    Ledger(root).add(f"model:{weights.sha256}", [(file, 1)])
    draft.record_checksums({file: hashlib.sha256(weights.content).hexdigest()})
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
    """A store's model in evaluation mode. Raises RequestError if it cannot be loaded."""
    if name not in store.models:
        raise RequestError(f"model {name!r}: not in {store.path} (has: {', '.join(store.models)})")
    record = store.models[name]
    if record.architecture == TORCHSCRIPT:
        _require_trust(trust, f"model {name!r} (TorchScript)")
        path, content = _stored_weights(store, record.sha256, MAX_TORCHSCRIPT_BYTES)
        network: PoseNetwork = OpaqueNetwork.from_torchscript(content, str(path))
    else:
        network = _untrained_network(record.architecture, trust)
        path, content = _stored_weights(store, record.sha256, _max_bytes(network))
        check_archive(path, content)
        _load_state(network, read_state(path, content), str(path))
    network.eval().requires_grad_(False)
    convention = parse_convention(record.convention)
    return LoadedModel(name, record.architecture, network, convention, record.sha256)


def _stored_weights(store: Store, sha256: str, max_bytes: int) -> tuple[Path, bytes]:
    """Path and content of a model's weights file, which must not be a link."""
    start = f"{layout.MODELS}/{sha256}."
    try:
        entries = safe_files.names(store.path, layout.MODELS)
        file = next((entry.path for entry in entries if entry.path.startswith(start)), None)
        if file is None:
            raise RequestError(f"{store.path / start}*: missing; add the model again")
        return store.path / file, safe_files.read(store.path, file, max_bytes)
    except OSError as error:
        reason = safe_files.error_text(error)
        where = error.filename or store.path / layout.MODELS
        raise RequestError(f"{where}: cannot be read ({reason})") from error


def _untrained_network(architecture: str, trust: bool) -> PoseNetwork:
    if ":" not in architecture:
        return build_network(architecture)
    _require_trust(trust, architecture)
    module, _, factory = architecture.partition(":")
    try:
        network = getattr(importlib.import_module(module), factory)()
    except (ImportError, AttributeError, ValueError, TypeError) as error:
        known = ", ".join(ARCHITECTURES)
        raise RequestError(f"architecture {architecture}: {error} (built in: {known})") from error
    if isinstance(network, PoseNetwork):
        return network
    if isinstance(network, nn.Module):
        return OpaqueNetwork(network)
    raise RequestError(
        f"architecture {architecture}: returned {type(network).__name__}, not a module"
    )


def _require_trust(trust: bool, what: str) -> None:
    if not trust:
        raise RequestError(f"{what} executes code when it is loaded; add --trust if you trust it")


def read_state(path: Path, content: bytes) -> dict[str, Tensor]:
    """Tensors of a weights file, read without running code from it. Raises RequestError."""
    try:
        if path.suffix == ".safetensors":
            loaded: Any = load_safetensors(content)
        else:
            with bounded_memory(2 * len(content) + _UNPICKLING_BYTES):
                loaded = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise RequestError(
            f"{path}: {_unpickling_reason(str(error))}; save its state_dict()"
        ) from error
    except (SafetensorError, RuntimeError, EOFError, MemoryError, *_DECODING_ERRORS) as error:
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise RequestError(f"{path}: not a plain state dict ({reason})") from error
    for wrapper in _WRAPPER_KEYS:
        if isinstance(loaded, Mapping) and isinstance(loaded.get(wrapper), Mapping):
            loaded = loaded[wrapper]
    if not isinstance(loaded, Mapping) or not all(isinstance(v, Tensor) for v in loaded.values()):
        raise RequestError(f"{path}: no state dict in it (a mapping of names to tensors)")
    return {str(key).removeprefix("module."): value for key, value in loaded.items()}


def _unpickling_reason(message: str) -> str:
    """Why a pickle was refused, from the message of torch's restricted unpickler."""
    match = re.search(r"GLOBAL ([\w.]+)", message)
    if match:
        return f"loading it would run code ({match[1]}), which is refused"
    return "not a file of tensors that torch can read without running code"


def _load_state(into: PoseNetwork, state: dict[str, Tensor], where: str) -> None:
    network = _stored_module(into)
    expected = network.state_dict()
    optional = {key for key in expected if key.endswith("num_batches_tracked")}
    missing = [key for key in expected if key not in state and key not in optional]
    extra = [key for key in state if key not in expected]
    shaped = [k for k, v in state.items() if k in expected and v.shape != expected[k].shape]
    for defect, keys in (("no", missing), ("unknown", extra), ("wrong shape of", shaped)):
        if keys:
            more = f" and {len(keys) - 3} more" if len(keys) > 3 else ""
            raise RequestError(f"{where}: {defect} {', '.join(keys[:3])}{more}; another --arch?")
    check_tensors(state, expected, where)
    not_finite = [k for k, v in state.items() if v.is_floating_point() and not v.isfinite().all()]
    if not_finite:
        raise RequestError(f"{where}: {not_finite[0]} holds values that are not finite")
    network.load_state_dict(state, strict=False)


def _cpu_tensors(state: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {key: value.detach().cpu().contiguous().clone() for key, value in state.items()}
