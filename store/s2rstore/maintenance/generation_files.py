"""The files of a store that its published generation needs, with the checksums that are known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from s2rstore.arrays.stored_array import METADATA
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, safe_files
from s2rstore.files.ledger import LedgerEntry, LedgerReader
from s2rstore.reader import Store


@dataclass(frozen=True, slots=True)
class GenerationFile:
    """A file by its path inside the store, with the ledger entries that may prove it.

    Without any, nothing is known of its content.
    """

    path: str
    bytes: int
    proofs: tuple[LedgerEntry, ...]


def generation_files(store: Store, current: layout.Current) -> list[GenerationFile]:
    """The files of an open generation but `CURRENT.json`, the ledger and the gap history.

    They never change. Raises RequestError where one is missing, or is no regular file.
    """
    known = _checksums(store, current)
    proven = LedgerReader(store.files).by_path()
    files = {}
    for entry in _entries(store, current):
        if entry.kind == "folder" or atomic_writes.is_partial(entry.name):
            continue
        if entry.kind != "file":
            raise RequestError(f"{store.path / entry.path}: not a regular file; run `s2r verify`")
        proofs = proven.get(entry.path, [])
        if entry.path in known:
            proofs = [LedgerEntry("push", entry.path, entry.bytes, known[entry.path], 1)]
        files[entry.path] = GenerationFile(entry.path, entry.bytes, tuple(proofs))
    for path in _required(store, current):
        if path not in files:
            raise RequestError(f"{store.path / path}: missing; run `s2r verify`")
    return [files[path] for path in sorted(files)]


def _checksums(store: Store, current: layout.Current) -> dict[str, str]:
    """The checksums that the index and `CURRENT.json` state."""
    known = {current.index: current.sha256, **store.checksums}
    for run in store.runs:
        for record in store.array_parts(run):
            known[f"{layout.RUNS}/{record.path}/{METADATA}"] = record.metadata_sha256
    for group in store.row_files.values():
        known.update((f"{layout.INDEX}/{file.path}", file.sha256) for file in group)
    return known


def _entries(store: Store, current: layout.Current) -> Iterator[safe_files.FolderEntry]:
    """Everything in the folders of a generation."""
    files = store.files
    rows = [file for group in store.row_files.values() for file in group]
    for path in (current.index, *(f"{layout.INDEX}/{file.path}" for file in rows)):
        yield safe_files.FolderEntry(path, "file", files.size(path))
    weights = {model.sha256 for model in store.models.values()}
    for entry in files.names(layout.MODELS):
        if Path(entry.path).name.partition(".")[0] in weights:
            yield entry
    for folder in _folders(store):
        yield from files.walk(folder)


def _folders(store: Store) -> list[str]:
    domains, parts = store.domains, store.trajectory_parts
    frames = [f"{layout.FRAMES}/{d}/{part.folder}" for d in domains for part in parts]
    arrays = {f"{layout.RUNS}/{'/'.join(path.split('/')[:2])}" for path in store.array_paths}
    return [*frames, *sorted(arrays), layout.TRANSLATORS, layout.ASSETS, layout.DRIVES]


def _required(store: Store, current: layout.Current) -> Iterator[str]:
    """The files without which the generation cannot be read."""
    yield from _checksums(store, current)
    arrays = [store.stored(r) for run in store.runs for r in store.array_parts(run)]
    for domain, parts in store.imaged_parts.items():
        for part in parts:
            images = ("rgb", "depth") if store.domain(domain).has_depth else ("rgb",)
            arrays += [store.frames_array(domain, part, image) for image in images]
            if folder := store.labels_folder(domain, part):
                arrays.append(store.labels_array(part, folder))
            if store.has_source_frames(domain, part):
                arrays += [store.source_array(domain, part, image) for image in images]
    for array in arrays:
        yield from map(array.file, range(array.layout.shards))
