"""Register a model: check a weights file, store its weights and list it in the index."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

from safetensors.torch import save

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout
from s2rstore.files.input_files import check_regular, read_bytes
from s2rstore.files.ledger import Ledger
from s2rstore.index.transaction import IndexTransaction, edit
from s2rstore.records import ARCHIVES
from s2rtools.common.weights_file import (
    MAX_TORCHSCRIPT_BYTES,
    check_archive_kind,
    read_state,
    read_weights_file,
)
from s2rtools.models import ARCHITECTURES
from s2rtools.models.conventions import OutputConvention, parse_convention
from s2rtools.models.input_check import output_width
from s2rtools.models.input_contract import InputContract, InputOverride, read_override
from s2rtools.models.load_model import (
    build_trusted_network,
    load_state,
    max_weights_bytes,
    require_trust,
    stored_module,
)
from s2rtools.models.pose_network import PoseNetwork
from s2rtools.models.torchscript import EXPORTED, TORCHSCRIPT, OpaqueNetwork

_SUFFIXES = {TORCHSCRIPT: ".torchscript", EXPORTED: ".pt2"}
DEFAULT_CONVENTIONS = {name: network.convention for name, network in ARCHITECTURES.items()}


@dataclass(frozen=True, slots=True)
class Weights:
    """A checked weights file, ready to be stored; `content` is stored.

    `sha256` is that of the original file, `outputs` the width of the network's output.
    """

    architecture: str
    sha256: str
    content: bytes
    suffix: str
    contract: InputContract
    outputs: int


def add_model(
    root: Path, name: str, file: Path, architecture: str, convention: str | None, trust: bool,
    input_file: Path | None = None,
) -> InputContract:  # fmt: skip
    """Check a weights file and publish it as a model; return its input contract.

    `input_file` overrides keys of the contract that the architecture declares, and may name the
    convention. One forward pass checks that the network takes its input. Raises RequestError.
    """
    layout.checked_name(name, "model")
    with s2rstore.open(root) as store:
        if name in store.models:
            raise RequestError(f"model {name!r}: already in {root}; choose another name")
    override = read_override(input_file) if input_file is not None else None
    if override is not None and override.convention is not None:
        if convention is not None:
            raise RequestError(f"--convention: {override.path} names one, too; give it once")
        convention = override.convention
    weights = read_weights(file, architecture, trust, override)
    if convention is None and architecture not in DEFAULT_CONVENTIONS:
        raise RequestError(
            f"--convention: {architecture} has no default; name heading unit and frame, here or by "
            "the key convention of a file for --input"
        )
    output = parse_convention(convention) if convention else DEFAULT_CONVENTIONS[architecture]
    with edit(root) as draft:
        check_name_free(draft, "model", name)
        register_model(root, draft, name, weights, output)
        draft.set_provenance(f"model:{name}", {"file": file.name, "file_sha256": weights.sha256})
    return weights.contract


def read_weights(
    path: Path, architecture: str, trust: bool = False, override: InputOverride | None = None
) -> Weights:
    """Check a weights file against an architecture, and the network against its input contract.

    State dicts (.pt, .pth) are read with `weights_only=True`; architectures `torchscript`,
    `torch.export` and `module:factory` execute code and need `trust`. Raises RequestError naming
    the file if it does not fit.
    """
    if architecture in ARCHIVES:
        require_trust(trust, architecture)
        content = read_bytes(path, MAX_TORCHSCRIPT_BYTES)
        check_archive_kind(path, content, architecture)
        digest = hashlib.sha256(content).hexdigest()
        opaque = OpaqueNetwork.from_archive(architecture, content, str(path), None, override)
        suffix, outputs = _SUFFIXES[architecture], opaque.embedding_size
        return Weights(architecture, digest, content, suffix, opaque.contract, outputs)
    check_regular(path)
    network = build_trusted_network(architecture, trust, override=override)
    content = read_weights_file(path, max_weights_bytes(network))
    load_state(network, read_state(path, content), str(path))
    digest = hashlib.sha256(content).hexdigest()
    packed = replace(pack_weights(network), architecture=architecture, sha256=digest)
    if isinstance(network, OpaqueNetwork):
        return packed
    contract = override.applied(network.contract) if override else network.contract
    output_width(network.eval(), contract, str(path), override)
    return replace(packed, contract=contract)


def pack_weights(network: PoseNetwork) -> Weights:
    """Weights of a network in memory."""
    state = stored_module(network).state_dict()
    content = save({k: v.detach().cpu().contiguous().clone() for k, v in state.items()})
    digest = hashlib.sha256(content).hexdigest()
    contract, outputs = network.contract, network.convention.width
    return Weights(network.architecture, digest, content, ".safetensors", contract, outputs)


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
            f"the network returns {weights.outputs}; name another --convention, or another "
            "convention in the file of --input"
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
            "input_height": weights.contract.size[0],
            "input_width": weights.contract.size[1],
            "convention": convention.to_json(),
            "trained_by": trained_by,
            "input": weights.contract.to_json(),
        },
    )


def check_name_free(draft: IndexTransaction, table: str, name: str) -> None:
    """Raises RequestError if another process has used the name in the meantime."""
    if draft.rows(f'SELECT 1 FROM "{table}" WHERE "{table}" = ?', [name]):
        raise RequestError(
            f"{table} {name!r}: another process has just used the name; choose another"
        )
