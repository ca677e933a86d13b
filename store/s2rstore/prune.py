"""Removing what no kept generation needs."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from s2rstore import layout, locks, sandbox, schema
from s2rstore.errors import RequestError
from s2rstore.ledger import Ledger


@dataclass(frozen=True, slots=True)
class Pruned:
    """What was removed, as paths inside the store, and how many bytes that freed."""

    paths: tuple[str, ...]
    bytes: int


def prune(root: Path, keep: int = 3, dry_run: bool = False) -> Pruned:
    """Keep the newest `keep` generations and what they reference; remove the rest.

    Takes the compute lock, so that no half-written unit is mistaken for refuse. Raises
    StoreBusyError while a precompute runs, RequestError for a store that another release wrote
    or whose published index is missing.
    """
    layout.read_current(root)
    with locks.compute_lock(root), locks.publish_lock(root):
        current = layout.read_current(root)
        if current.schema != schema.VERSION:
            raise RequestError(f"{root}: schema {current.schema}; prune it with its own release")
        if not (root / current.index).is_file():
            raise RequestError(f"{root / current.index}: the published index is missing")
        indexes = sorted(
            (number, path)
            for path in (root / layout.INDEX).glob("index-*.duckdb")
            if (number := layout.generation_of(path)) is not None
        )
        wanted = {number for number, _ in indexes if number <= current.generation}
        kept = sorted(wanted)[-max(1, keep) :]
        gone = [path for number, path in indexes if number not in kept]
        keep_paths = [path for number, path in indexes if number in kept]
        gone += _unreferenced(root, keep_paths)
        size = sum(_bytes(path) for path in gone)
        if not dry_run:
            _remove(root, gone)
    return Pruned(tuple(path.relative_to(root).as_posix() for path in gone), size)


def _unreferenced(root: Path, indexes: list[Path]) -> list[Path]:
    arrays: set[str] = set()
    weights: set[str] = set()
    for index in indexes:
        connection = sandbox.connect(index)
        try:
            arrays |= {
                row[0] for row in connection.execute("SELECT path FROM zarr_array").fetchall()
            }
            weights |= {row[0] for row in connection.execute("SELECT sha256 FROM model").fetchall()}
        finally:
            connection.close()
    used = {"/".join(path.split("/")[:2]) for path in arrays}
    runs = root / layout.RUNS
    gone = [
        folder
        for folder in sorted(runs.glob("*/*"))
        if folder.is_dir() and folder.relative_to(runs).as_posix() not in used
    ]
    gone += [
        path
        for path in sorted((root / layout.MODELS).glob("*"))
        if path.name.split(".")[0] not in weights
    ]
    return gone


def _bytes(path: Path) -> int:
    if path.is_file():
        return path.stat().st_size
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())


def _remove(root: Path, gone: list[Path]) -> None:
    files: set[str] = set()
    for path in gone:
        if path.is_dir():
            files |= {f.relative_to(root).as_posix() for f in path.rglob("*") if f.is_file()}
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
    Ledger(root).forget(files)
    for folder in (root / layout.RUNS).glob("*"):
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
