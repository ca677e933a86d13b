"""The arrays of a trajectory's stored instances: those of each domain and image."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from s2rstore.arrays import array_writer
from s2rstore.arrays.zarr_metadata import Layout
from s2rstore.dataset_reader import SOURCE_IMAGES
from s2rstore.files import layout
from s2rstore.files.ledger import Ledger, LedgerEntry
from s2rtools.datasets.scan import DecodedFrame
from s2rtools.datasets.stored_instances import StoredTrajectory
from s2rtools.datasets.writing import source_arrays
from s2rtools.datasets.writing.growing_array import GrowingArray
from s2rtools.datasets.writing.ingest_journal import SHARD_ROWS, Block
from s2rtools.datasets.writing.source_arrays import CompressedImages

Frames = Mapping[str, DecodedFrame]
Sources = Mapping[str, CompressedImages]


class TrajectoryArrays:
    """The frames of a trajectory's instances as they are written, and the instances in `stored`.

    `folder` is that of the trajectory in the folder of each domain below `root`.
    """

    def __init__(
        self, root: Path, folder: str, domains: Sequence[str], stored: StoredTrajectory
    ) -> None:
        self.stored = stored
        self._root, self._folder = root, folder
        self._arrays: dict[str, dict[str, GrowingArray[Any]]] = {}
        for domain in domains:
            base = f"{layout.FRAMES}/{domain}/{folder}"
            frames = {image: _frame_array(root, f"{base}/{image}") for image in ("rgb", "depth")}
            sources = {
                image: source_arrays.source_array(root, f"{base}/{image}")
                for image in SOURCE_IMAGES.values()
            }
            self._arrays[domain] = {**frames, **sources}
        self._recorded = 0

    @property
    def pending_rows(self) -> int:
        """Number of instances that the journal does not record yet."""
        return len(self.stored) - self._recorded

    def add(self, row: int, frames: Frames, sources: Sources) -> None:
        """Write the frames of the record number `row`."""
        for domain, frame in frames.items():
            for image, pixels in (("rgb", frame.rgb), ("depth", frame.depth)):
                if pixels is not None:
                    array = self._arrays[domain][image]
                    array.add(pixels, pixels.shape, str(pixels.dtype))
        for domain, images in sources.items():
            for name, each in images.items():
                self._arrays[domain][name].add(each.content, each.shape, each.dtype)
        self.stored.add(row, frames)

    def take(self, row: int, block: Block) -> None:
        """Count a record of a block as stored, and its files with its first record."""
        position = len(self.stored) - self._recorded
        self.stored.add_checksums(row, block.checksums(position))
        if position == 0:
            for domain, shards in block.shards.items():
                for image, shard in shards.items():
                    self._arrays[domain][image].take(shard, len(block.rows))
        if position == len(block.rows) - 1:
            self._recorded = len(self.stored)

    def fill(self, block: Block) -> None:
        """Put the instances that are in no block yet into one, with the shards that hold them."""
        start, self._recorded = self._recorded, len(self.stored)
        block.add_rows(self.stored, start)
        if not block.rows:
            return
        for domain, arrays in self._arrays.items():
            block.shards[domain] = {}
            for image, each in arrays.items():
                if not each.is_empty:
                    each.flush()
                    block.shards[domain][image] = each.last_shard

    def finish(self) -> None:
        """Complete the arrays and list their files in the ledger."""
        entries: list[LedgerEntry] = []
        for domain, arrays in self._arrays.items():
            key = f"frames:{domain}:{self._folder}"
            files = [
                (shard, replace(entry, key=f"{key}:{image}:{shard}"))
                for image, each in arrays.items()
                for shard, entry in enumerate(each.finish())
            ]
            entries += [entry for _, entry in sorted(files, key=lambda file: file[0])]
        Ledger(self._root).add_entries(entries)


def _frame_array(root: Path, folder: str) -> GrowingArray[NDArray[Any]]:
    def plan(count: int, item: tuple[int, ...], dtype: str) -> Layout:
        return array_writer.plan_layout(count, item, dtype, SHARD_ROWS)

    def encode(layout: Layout, rows: Sequence[NDArray[Any]]) -> list[bytes]:
        return array_writer.encode_chunks(layout, np.stack(rows))

    return GrowingArray(root, folder, plan, encode)
