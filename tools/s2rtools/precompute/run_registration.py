"""Register runs in a store."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files import locks
from s2rstore.files.layout import checked_name
from s2rstore.geometry.camera_offset import UNCHANGED, render_change
from s2rstore.index.transaction import IndexTransaction, edit
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rtools.adjustments import translator_name, with_hashes
from s2rtools.models.model_registration import check_name_free
from s2rtools.synthetic_world.stored_world import open_renderer

Chains = Mapping[str, Sequence[Mapping[str, Any]]]


def add_run(
    root: Path, name: str, model: str, sim: str | None, real: str | None, chains: Chains,
    force: bool = False,
) -> str:  # fmt: skip
    """Publish a run that is not computed yet; return its name.

    Raises RequestError, also if a chain moves cameras that cannot be rendered, or translates by a
    translator that failed a check of its content; `force` allows the latter.
    """
    for side, chain in chains.items():
        names = [str(step["name"]) for step in chain]
        repeated = next((name for name in names if names.count(name) > 1), None)
        if repeated is not None:
            raise RequestError(f"--adjust {side}: {repeated} twice; name each adjustment once")
    with s2rstore.open(root) as store:
        store.require_poses("a run")
        check_run_name(store, name)
        if model not in store.models:
            known = ", ".join(store.models) or "none"
            raise RequestError(f"--model {model}: not in {root} (models: {known})")
        domains = find_domain(store, "sim", sim), find_domain(store, "real", real)
        chains = {
            side: checked_translators(store, side, domain, chains[side], force)
            for side, domain in zip(SIDES, domains, strict=True)
        }
        if store.models[model].channels != "rgb":
            store.require_depth(domains, f"model {model}")
        for domain, chain in zip(domains, (chains["sim"], chains["real"]), strict=True):
            if render_change(chain, store.domain(domain), store.dataset.frame_width) != UNCHANGED:
                open_renderer(store, domain)
    with edit(root) as draft:
        check_name_free(draft, "run", name)
        insert_run(draft, name, model, domains, chains)
    return name


def check_run_name(store: Store, name: str) -> None:
    """Raise RequestError for a name that no new run of a store can have."""
    checked_name(name, "run")
    if name in store.runs:
        raise RequestError(f"run {name!r}: already in {store.path}; choose another name")


def checked_translators(
    store: Store, side: Side, domain: str, chain: Sequence[Mapping[str, Any]], force: bool
) -> list[dict[str, Any]]:
    """The chain with the hash of each translator.

    Raises RequestError for a translator of another domain, and for one that failed a check of its
    content unless `force`.
    """
    steps = with_hashes(chain, store.translators)
    for step in steps:
        name = translator_name(str(step["name"]))
        if name is None:
            continue
        record = store.translators[name]
        if record.source_domain != domain:
            raise RequestError(
                f"--adjust {side}:translate={name}: translates images of domain "
                f"{record.source_domain}, the {side} domain is {domain}"
            )
        if record.accepted is False and not force:
            raise RequestError(
                f"--adjust {side}:translate={name}: refused ({'; '.join(record.reasons)}); "
                "add --force to use it all the same"
            )
    return steps


def drop_run(root: Path, name: str) -> bool:
    """Remove a run that was never published; False if there is no such run.

    Its arrays stay until `s2r prune`; a new run with the same name and inputs reuses them. Raises
    StoreBusyError, and removes nothing, while another process computes: it may compute the run.
    """
    with locks.compute_lock(root) as lease:
        with s2rstore.open(root) as store:
            if name not in store.runs or store.runs[name].key is not None:
                return False
        with edit(root, lease.check) as draft:
            draft.delete("run", run=name)
    return True


def insert_run(
    draft: IndexTransaction,
    name: str,
    model: str | None,
    domains: tuple[str, str],
    chains: Chains | None = None,
) -> None:
    """Insert a run into the next generation; `model` is None for imported predictions."""
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


def find_domain(store: Store, kind: Side, name: str | None) -> str:
    """The named domain of a kind; by default `sim` / `real`, or the first of that kind."""
    names = [key for key, domain in store.domains.items() if domain.kind == kind]
    if name is None:
        name = kind if kind in names else next(iter(names), None)
    if name not in names:
        raise RequestError(f"--{kind} {name}: no {kind} domain (has: {', '.join(names)})")
    return name
