"""Registering models and runs in a store."""

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
        raise RequestError(f"--convention: {architecture} does not say how to read its output")
    read = parse_convention(convention) if convention else DEFAULT_CONVENTIONS[architecture]
    with edit(root) as draft:
        check_name_free(draft, "model", name)
        register_model(root, draft, name, weights, read)
        draft.note(f"model:{name}", {"file": file.name, "file_sha256": weights.sha256})


def add_run(
    root: Path, name: str, model: str, sim: str | None, real: str | None, chains: Chains
) -> str:
    """Publish a run that is not computed yet; gives its name. Raises RequestError."""
    checked_name(name, "run")
    for side, chain in chains.items():
        names = [str(step["name"]) for step in chain]
        twice = next((one for one in names if names.count(one) > 1), None)
        if twice is not None:
            raise RequestError(f"--adjust {side}: {twice} twice; name each adjustment once")
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
    """Take a run that was never computed out of the store; False where it is not that.

    Its arrays stay until `s2r prune`: a run of that name and the same facts takes them up.
    """
    with s2rstore.open(root) as store:
        if name not in store.runs or store.runs[name].key is not None:
            return False
    with edit(root) as draft:
        if draft.rows("SELECT 1 FROM run WHERE run = ? AND key IS NULL", [name]):
            draft.delete("run", run=name)
    return True


def _check_move(store: Store, domain: str, chain: Sequence[Mapping[str, Any]]) -> None:
    """Raises RequestError where a chain moves cameras that it cannot."""
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
    """List a run in the next generation."""
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
    """Raises RequestError where another process took the name since it was looked up."""
    if draft.rows(f'SELECT 1 FROM "{table}" WHERE "{table}" = ?', [name]):
        raise RequestError(f"{table} {name!r}: somebody else has just taken it; choose another")


def find_domain(store: Store, kind: Side, wanted: str | None) -> str:
    """The named domain if it is of that kind, by default `sim` / `real` or the first of it."""
    names = [name for name, domain in store.domains.items() if domain.kind == kind]
    if wanted is None:
        wanted = kind if kind in names else next(iter(names), None)
    if wanted not in names:
        raise RequestError(f"--{kind} {wanted}: no {kind} domain (has: {', '.join(names)})")
    return wanted


def _refuse_existing(name: str, taken: Mapping[str, Any], what: str, root: Path) -> None:
    if name in taken:
        raise RequestError(f"{what} {name!r}: already in {root}; choose another name")
