"""Fingerprint of everything that the figures of a night depend on: equal keys, equal figures."""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import msgspec

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.files.documents import read_document
from s2rstore.files.input_files import sha256
from s2rstore.reader import Store
from s2rtools.gap.axes import ODOMETRY
from s2rtools.nightly.config import NightlyConfig


@dataclass(frozen=True, slots=True)
class Inputs:
    """Hashes of the inputs: `key` of everything, `evidence` of the recordings.

    `parts` are the hashes of the recordings one by one: data set, run and drives.
    """

    key: str
    evidence: str
    parts: tuple[str, ...]
    run: str


def version() -> str:
    """Version of the program, empty where it is not installed."""
    try:
        return metadata.version("s2rtui")
    except metadata.PackageNotFoundError:
        return ""


def open_store(path: Path) -> tuple[Store, layout.Current]:
    """Open a store together with the published state that it was opened at."""
    while True:
        current = layout.read_current(path)
        store = s2rstore.open(path)
        if store.generation == current.generation:
            return store, current
        store.close()


def inputs(config: NightlyConfig, store: Store, current: layout.Current) -> Inputs:
    """Fingerprint the inputs. Raises RequestError for uncomputed runs and unreadable files."""
    request = config.request
    run = store.run(request.run)
    if not run.key:
        raise RequestError(f"{store.path}: run {run.run} is not computed; run `s2r precompute`")
    drives, sysid_drives = _drives(request.drives), []
    sysid: dict[str, Any] | None = None
    if config.sysid is not None:
        settings = msgspec.structs.asdict(config.sysid)
        sysid_drives = _drives(settings.pop("drives"))
        sysid = {"options": settings, "drives": sysid_drives}
    options = sorted(f"{name}={text}" for name, text in request.options.items())
    logs = {digest for _, digest in (*drives, *sysid_drives)}
    recorded = [current.dataset_hash, run.key, *sorted(logs)]
    everything = {
        "version": version(),
        "dataset": current.dataset_hash,
        "index": current.sha256,
        "run": [run.run, run.key],
        "select": request.expression,
        "axes": sorted(request.axes),
        "threshold": request.threshold,
        "margin": request.margin,
        "seed": request.settings.seed,
        "stale_after": config.stale_after,
        "drives": [
            request.drives == ODOMETRY,
            request.rate,
            request.topic,
            options,
            drives,
        ],
        "sysid": sysid,
        **{name: _hash(getattr(request, name)) for name in ("reference", "golden")},
        "features": _network(request.features),
    }
    return Inputs(_digest(everything), _digest(recorded), tuple(recorded), run.run)


def _drives(folder: str | None) -> list[tuple[str, str]]:
    """Name and hash of every file except hidden ones, which unfinished copies leave.

    Empty for odometry, which is part of the data set.
    """
    if folder is None or folder == ODOMETRY:
        return []
    paths = [(path, path.relative_to(folder)) for path in sorted(Path(folder).rglob("*"))]
    return [
        (inside.as_posix(), sha256(path))
        for path, inside in paths
        if path.is_file() and not any(part.startswith(".") for part in inside.parts)
    ]


def _network(path: Path | None) -> list[str] | None:
    """Hashes of a network's description and of the weights file that it names."""
    if path is None:
        return None
    hashes, data = [sha256(path)], None
    with suppress(RequestError):
        data = read_document(path)
    weights = data.get("weights") if isinstance(data, dict) else None
    if weights and isinstance(weights, str):
        hashes.append(sha256(path.parent / weights))
    return hashes


def _hash(path: Path | None) -> str | None:
    return None if path is None else sha256(path)


def _digest(content: object) -> str:
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
