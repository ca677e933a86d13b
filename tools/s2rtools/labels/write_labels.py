"""Store label images with a list of classes, and compute what the labelled objects cost."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

import s2rstore
from s2rstore.arrays import array_writer
from s2rstore.arrays.stored_array import METADATA
from s2rstore.dataset_reader import UNLABELLED, labels_folder
from s2rstore.errors import RequestError
from s2rstore.files import locks, safe_files
from s2rstore.files.ledger import Ledger, LedgerEntry
from s2rstore.index import schema
from s2rstore.index.transaction import check_writable, edit
from s2rstore.reader import Store
from s2rstore.records import SIDES, TrajectoryPart
from s2rtools.common.frame_resizing import resized_depth
from s2rtools.labels.label_sources import LabelImage, LabelSource
from s2rtools.precompute.label_gains import update_label_gains
from s2rtools.synthetic_world.dataset import WorldData

Open = Callable[[Store], LabelSource]
_KEPT = 1024
"""Rendered label images that are kept in memory: 32 MB of 128 x 128 pixels."""


@dataclass(frozen=True, slots=True)
class StoredLabels:
    """How many label images were stored, of how many objects, and the runs with new gains.

    has_gains: whether the store has gains of any run.
    """

    images: int
    labels: int
    runs: list[str]
    has_gains: bool


def write_labels(root: Path, domain: str, open_source: Open, command: str) -> StoredLabels:
    """Publish the label images of a domain; they replace those that it has.

    `open_source` gives the images of an open store. Raises RequestError for an unknown domain,
    for unreadable images, and where another domain uses a value for another class.
    """
    check_writable(root)
    with locks.compute_lock(root) as lease:
        with s2rstore.open(root) as store:
            store.domain(domain)
            source = open_source(store)
            names = _names(store, domain, source)
            images = _Images(store, domain, source)
            shares = images.shares()
            entries = images.write()
            replaced = [
                f"{folder}/{METADATA}"
                for part in store.trajectory_parts
                if (folder := store.labels_folder(domain, part))
            ]
        Ledger(root).add_entries(entries)
        with edit(root, lease.check) as draft:
            draft.delete("label")
            draft.insert("label", {"label": list(names), "name": list(names.values())})
            draft.delete("frame_label", domain=domain)
            draft.insert("frame_label", {"domain": [domain] * shares["iid"].size, **shares})
            for path in replaced:
                draft.delete("provenance", what=schema.CHECKSUMS, key=path)
            draft.record_checksums(images.checksums())
            draft.set_provenance(schema.LABELS, {domain: images.key})
            draft.set_provenance(f"{schema.LABELS}:{domain}", {"command": command})
        runs = update_label_gains(root, lease.check)
        with s2rstore.open(root) as store:
            has_gains = bool(store.execute("SELECT 1 FROM label_gain LIMIT 1"))
    return StoredLabels(len(source.iids), len(np.unique(shares["label"])), runs, has_gains)


def _names(store: Store, domain: str, source: LabelSource) -> dict[int, str]:
    """The classes of the source and of the other labelled domains, by value."""
    stored = store.label_names if store.label_keys.keys() - {domain} else {}
    for label, name in source.names.items():
        if stored.get(label, name) != name:
            raise RequestError(
                f"label {label} is {name!r} here and {stored[label]!r} in another domain of "
                f"{store.path}; one value has one name in a store"
            )
    return dict(sorted({**stored, **source.names}.items()))


class _Images:
    """The label images of a domain at the frame size, one array for each part with images."""

    def __init__(self, store: Store, domain: str, source: LabelSource) -> None:
        self._root, self._domain, self._source = store.path, domain, source
        self._size = store.dataset.frame_height, store.dataset.frame_width
        self._parts = [
            part for part in store.trajectory_parts
            if not source.iids.isdisjoint(range(part.first_iid, part.stop))
        ]  # fmt: skip
        self.key = ""

    def shares(self) -> dict[str, np.ndarray]:
        """Columns of table `frame_label`; reads every image once, and sets the key."""
        digest = hashlib.sha256(f"{self._domain} {self._size}".encode())
        iids, labels, shares = [], [], []
        for iid in sorted(self._source.iids):
            image = self._image(iid)
            digest.update(iid.to_bytes(8) + image.tobytes())
            shown, counts = np.unique(image, return_counts=True)
            kept = shown != UNLABELLED
            iids.append(np.full(int(kept.sum()), iid))
            labels.append(shown[kept])
            shares.append(counts[kept] / image.size)
        self.key = digest.hexdigest()[:16]
        return {
            "iid": np.concatenate(iids).astype(np.int32),
            "label": np.concatenate(labels).astype(np.int32),
            "share": np.concatenate(shares).astype(np.float32),
        }

    def write(self) -> list[LedgerEntry]:
        """Write the arrays; gives the entries of their shards."""
        entries = []
        for part in self._parts:
            folder = self._folder(part)
            plan = array_writer.plan_layout(
                part.instances, self._size, "uint16", array_writer.SHARD_ROWS
            )
            array = array_writer.create(self._root / folder, plan, root=self._root)
            for shard in range(array.layout.shards):
                rows, first = array.rows_in(shard), part.first_iid + shard * plan.shard_rows
                chunks = (
                    chunk
                    for start in range(first, first + rows, plan.rows_per_chunk)
                    for chunk in array_writer.encode_chunks(
                        plan, self._rows(start, min(start + plan.rows_per_chunk, first + rows))
                    )
                )
                file = array_writer.write_chunks(self._root, folder, plan, shard, rows, chunks)
                entries.append(LedgerEntry(schema.LABELS, file.path, file.bytes, file.sha256, rows))
        return entries

    def checksums(self) -> dict[str, str]:
        """SHA-256 of the metadata of the arrays, by path."""
        paths = [f"{self._folder(part)}/{METADATA}" for part in self._parts]
        return {path: safe_files.sha256(self._root, path) for path in paths}

    def _folder(self, part: TrajectoryPart) -> str:
        return labels_folder(self._domain, part.folder, self.key)

    def _rows(self, start: int, stop: int) -> LabelImage:
        images = np.full((stop - start, *self._size), UNLABELLED, dtype=np.uint16)
        for iid in self._source.iids.intersection(range(start, stop)):
            images[iid - start] = self._image(iid)
        return images

    def _image(self, iid: int) -> LabelImage:
        return np.asarray(resized_depth(self._source.read(iid), self._size))


def label_world(root: Path, command: str) -> None:
    """Store the label images of both sides of a world; each object has a value of its own."""
    for side in SIDES:
        write_labels(root, side, partial(world_source, domain=side), command)


def world_source(store: Store, domain: str) -> LabelSource:
    """The labels of a side of the world that a store was made from; RequestError for other data."""
    data, side = WorldData.of_store(store), next((s for s in SIDES if s == domain), None)
    if data is None or side is None:
        raise RequestError(f"{store.path}: {domain} is no side of the synthetic world")
    poses, camera, renderer = store.poses(domain), data.camera(side), data.renderer(side)
    names = {number: item.name for number, item in enumerate(data.world.objects, 1)}

    @lru_cache(_KEPT)  # every image is read twice
    def read(iid: int) -> LabelImage:
        views = renderer.render(poses[iid : iid + 1], camera, samples=0)
        return views.identity[0].astype(np.uint16)

    return LabelSource(names, frozenset(np.flatnonzero(store.imaged(domain)).tolist()), read)
