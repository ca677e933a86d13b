"""Register models and runs in a store."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files.layout import checked_name
from s2rstore.geometry.camera_offset import UNMOVED, camera_move
from s2rstore.index.transaction import IndexTransaction, edit
from s2rstore.reader import Store
from s2rstore.records import Side
from s2rtools.models.conventions import parse_convention
from s2rtools.models.library import DEFAULT_CONVENTIONS, read_weights, register_model
from s2rtools.rendering import open_renderer

Chains = Mapping[str, Sequence[Mapping[str, Any]]]


def add_model(
    root: Path, name: str, file: Path, architecture: str, convention: str | None, trust: bool
) -> None:
    """Check a weights file and publish it as a model. Raises RequestError."""
    checked_name(name, "model")
    with s2rstore.open(root) as store:
        _refuse_existing(name, store.models, "model", root)
    weights = read_weights(file, architecture, trust)
    if convention is None and architecture not in DEFAULT_CONVENTIONS:
        raise RequestError(
            f"--convention: {architecture} has no default; name heading unit and frame"
        )
    output = parse_convention(convention) if convention else DEFAULT_CONVENTIONS[architecture]
    with edit(root) as draft:
        check_name_free(draft, "model", name)
        register_model(root, draft, name, weights, output)
        draft.set_provenance(f"model:{name}", {"file": file.name, "file_sha256": weights.sha256})


def add_run(
    root: Path, name: str, model: str, sim: str | None, real: str | None, chains: Chains
) -> str:
    """Publish a run that is not computed yet; return its name. Raises RequestError."""
    checked_name(name, "run")
    for side, chain in chains.items():
        names = [str(step["name"]) for step in chain]
        repeated = next((name for name in names if names.count(name) > 1), None)
        if repeated is not None:
            raise RequestError(f"--adjust {side}: {repeated} twice; name each adjustment once")
    with s2rstore.open(root) as store:
        _refuse_existing(name, store.runs, "run", root)
        if model not in store.models:
            known = ", ".join(store.models) or "none"
            raise RequestError(f"--model {model}: not in {root} (models: {known})")
        domains = find_domain(store, "sim", sim), find_domain(store, "real", real)
        for domain, chain in zip(domains, (chains["sim"], chains["real"]), strict=True):
            _check_move(store, domain, chain)
    with edit(root) as draft:
        check_name_free(draft, "run", name)
        insert_run(draft, name, model, domains, chains)
    return name


def drop_run(root: Path, name: str) -> bool:
    """Remove a run that was never published; False if there is no such run.

    Its arrays stay until `s2r prune`; a new run with the same name and inputs reuses them.
    """
    with s2rstore.open(root) as store:
        if name not in store.runs or store.runs[name].key is not None:
            return False
    with edit(root) as draft:
        if draft.rows("SELECT 1 FROM run WHERE run = ? AND key IS NULL", [name]):
            draft.delete("run", run=name)
    return True


def _check_move(store: Store, domain: str, chain: Sequence[Mapping[str, Any]]) -> None:
    """Raises RequestError if a chain moves cameras that cannot be rendered."""
    record = store.domain(domain)
    if camera_move(chain, record, store.dataset.frame_width) != UNMOVED:
        open_renderer(store, domain)


def insert_run(
    draft: IndexTransaction,
    name: str,
    model: str,
    domains: tuple[str, str],
    chains: Chains | None = None,
) -> None:
    """Insert a run into the next generation."""
    chains = chains or {"sim": [], "real": []}
    draft.insert_row(
        "run",
        {
            "run": checked_name(name, "run"),
            "model": model,
            "sim_domain": domains[0],
            "real_domain": domains[1],
            "sim_adjustments": list(chains["sim"]),
            "real_adjustments": list(chains["real"]),
            "created_at": datetime.now(UTC).isoformat(timespec="microseconds"),
        },
    )


def check_name_free(draft: IndexTransaction, table: str, name: str) -> None:
    """Raises RequestError if another process has used the name in the meantime."""
    if draft.rows(f'SELECT 1 FROM "{table}" WHERE "{table}" = ?', [name]):
        raise RequestError(
            f"{table} {name!r}: another process has just used the name; choose another"
        )


def find_domain(store: Store, kind: Side, name: str | None) -> str:
    """The named domain of a kind; by default `sim` / `real`, or the first of that kind."""
    names = [key for key, domain in store.domains.items() if domain.kind == kind]
    if name is None:
        name = kind if kind in names else next(iter(names), None)
    if name not in names:
        raise RequestError(f"--{kind} {name}: no {kind} domain (has: {', '.join(names)})")
    return name


def _refuse_existing(name: str, existing: Mapping[str, Any], table: str, root: Path) -> None:
    if name in existing:
        raise RequestError(f"{table} {name!r}: already in {root}; choose another name")
