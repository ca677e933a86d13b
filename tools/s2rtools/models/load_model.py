"""Load a model from a store; code in files is executed only if the user trusts them."""

from __future__ import annotations

import importlib
from functools import cache
from pathlib import Path

from torch import Tensor, nn

from s2rstore.errors import RequestError
from s2rstore.files import layout, safe_files
from s2rstore.reader import Store
from s2rstore.records import ARCHIVES
from s2rtools.common.weights_file import (
    MAX_TORCHSCRIPT_BYTES,
    check_archive,
    fill,
    max_file_bytes,
    parameter_bytes,
    read_state,
)
from s2rtools.models import ARCHITECTURES, build_network
from s2rtools.models.conventions import parse_convention
from s2rtools.models.input_contract import InputContract, InputOverride, contract_of
from s2rtools.models.pose_network import LoadedModel, PoseNetwork
from s2rtools.models.torchscript import OpaqueNetwork


def load_model(store: Store, name: str, trust: bool = False) -> LoadedModel:
    """A store's model in evaluation mode. Raises RequestError if it cannot be loaded."""
    if name not in store.models:
        raise RequestError(f"model {name!r}: not in {store.path} (has: {', '.join(store.models)})")
    record = store.models[name]
    contract = contract_of(record, f"{store.path}: model {name}")
    if record.architecture in ARCHIVES:
        require_trust(trust, f"model {name!r} ({record.architecture})")
        path, content = _stored_weights(store, record.sha256, MAX_TORCHSCRIPT_BYTES)
        network: PoseNetwork = OpaqueNetwork.from_archive(
            record.architecture, content, str(path), contract
        )
    else:
        network = build_trusted_network(record.architecture, trust, contract)
        path, content = _stored_weights(store, record.sha256, max_weights_bytes(network))
        check_archive(path, content)
        load_state(network, read_state(path, content), str(path))
    network.eval().requires_grad_(False)
    convention = parse_convention(record.convention)
    return LoadedModel(name, record.architecture, network, convention, record.sha256, contract)


def model_outline(store: Store, name: str, trust: bool = False) -> LoadedModel:
    """A store's model as far as shapes are concerned, in evaluation mode.

    Models of one built-in architecture share an untrained network, without reading their weights.
    Others are loaded. Raises RequestError if a model cannot be loaded.
    """
    record = store.models.get(name)
    if record is None or record.architecture not in ARCHITECTURES:
        return load_model(store, name, trust)
    convention = parse_convention(record.convention)
    network = _untrained_network(record.architecture)
    contract = contract_of(record, f"{store.path}: model {name}")
    return LoadedModel(name, record.architecture, network, convention, record.sha256, contract)


@cache
def _untrained_network(architecture: str) -> PoseNetwork:
    network = build_network(architecture).eval()
    network.requires_grad_(False)
    return network


def _stored_weights(store: Store, sha256: str, max_bytes: int) -> tuple[Path, bytes]:
    """Path and content of a model's weights file, which must not be a link."""
    start = f"{layout.MODELS}/{sha256}."
    try:
        names = (*store.checksums, *(entry.path for entry in store.files.names(layout.MODELS)))
        file = next((name for name in names if name.startswith(start)), None)
        if file is None:
            raise RequestError(f"{store.path / start}*: missing; add the model again")
        return store.path / file, store.files.read(file, max_bytes)
    except OSError as error:
        reason = safe_files.error_text(error)
        where = error.filename or store.path / layout.MODELS
        raise RequestError(f"{where}: cannot be read ({reason})") from error


def build_trusted_network(
    architecture: str,
    trust: bool,
    contract: InputContract | None = None,
    override: InputOverride | None = None,
) -> PoseNetwork:
    """An untrained network of a built-in architecture or of trusted `module:factory` code.

    `contract` and `override` are those of an `OpaqueNetwork`.
    """
    if ":" not in architecture:
        return build_network(architecture)
    require_trust(trust, architecture)
    module, _, factory = architecture.partition(":")
    try:
        network = getattr(importlib.import_module(module), factory)()
    except (ImportError, AttributeError, ValueError, TypeError) as error:
        known = ", ".join(ARCHITECTURES)
        raise RequestError(f"architecture {architecture}: {error} (built in: {known})") from error
    if isinstance(network, PoseNetwork):
        return network
    if isinstance(network, nn.Module):
        return OpaqueNetwork(network.eval(), contract, override, architecture)
    raise RequestError(
        f"architecture {architecture}: returned {type(network).__name__}, not a module"
    )


def require_trust(trust: bool, what: str) -> None:
    """Raises RequestError if the user does not trust code that would be executed."""
    if not trust:
        raise RequestError(f"{what} executes code when it is loaded; add --trust if you trust it")


def stored_module(network: PoseNetwork) -> nn.Module:
    """The module whose state dict a weights file contains."""
    return network.inner if isinstance(network, OpaqueNetwork) else network


def max_weights_bytes(network: PoseNetwork) -> int:
    """The maximum size in bytes of a weights file of the network."""
    return max_file_bytes(parameter_bytes(stored_module(network).state_dict()))


def load_state(into: PoseNetwork, state: dict[str, Tensor], where: str) -> None:
    """Load a state dict from a file named `where`. Raises RequestError if it does not fit."""
    fill(stored_module(into), state, where, "another --arch?")
