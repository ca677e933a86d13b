"""The arrays of a trajectory's stored instances: those of each domain and image.

Shards are written as their rows come, the metadata last. Images at the size of their source, from
which the input of a network is made, lie in one compressed image per chunk; they are compressed in
the threads that decode, because that takes longest.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import array_writer
from s2rstore.arrays.stored_array import shard_name
from s2rstore.arrays.zarr_metadata import Layout
from s2rstore.dataset_reader import SOURCE_IMAGES
from s2rstore.files.ledger import LedgerEntry
from s2rtools.datasets.scan import SourceImages
from s2rtools.datasets.writing.ingest_journal import SHARD_ROWS, Shard


@dataclass(frozen=True, slots=True)
class CompressedImage:
    """One image as it lies in the array: its shape, its type and the bytes of its chunk."""

    shape: tuple[int, ...]
    dtype: str
    content: bytes

    @classmethod
    def of(cls, image: NDArray[Any]) -> CompressedImage:
        layout = Layout((1, *image.shape), str(image.dtype), SHARD_ROWS, 1)
        (content,) = array_writer.encode_chunks(layout, image[None])
        return cls(image.shape, str(image.dtype), content)


CompressedImages = dict[str, CompressedImage]
"""By the name of the array."""


def compressed(source: SourceImages | None) -> CompressedImages:
    """The images of a frame, compressed; empty without a source of another size."""
    if source is None:
        return {}
    images = {"rgb": source.rgb, "depth": source.depth}
    return {
        SOURCE_IMAGES[name]: CompressedImage.of(image)
        for name, image in images.items()
        if image is not None
    }


def sizes_of(images: CompressedImages) -> tuple[tuple[int, ...], ...]:
    """Rows and columns of the images of a frame; equal in all frames of an array."""
    return tuple(image.shape[:2] for image in images.values())


class GrowingArray:
    """An array in `folder` inside `root`.

    Its rows are pixels, or with `holds_chunks` the contents of chunks of one row.
    """

    def __init__(self, root: Path, folder: str, holds_chunks: bool) -> None:
        self.folder = folder
        self._root, self._holds_chunks = root, holds_chunks
        self._rows: list[Any] = []
        self._count = 0
        self._entries: list[LedgerEntry] = []

    def add(self, row: NDArray[Any] | bytes, shape: tuple[int, ...], dtype: str) -> None:
        """Add a row, and write a shard that it completes."""
        self._item = shape, dtype
        self._rows.append(row)
        self._count += 1
        if len(self._rows) == SHARD_ROWS:
            self.flush()

    def take(self, shard: Shard, rows: int) -> None:
        """Count a file that an interrupted ingest has written as the next shard."""
        self._item, self._count = (shard.item, shard.dtype), self._count + rows
        name = f"{self.folder}/{shard_name(self._layout, len(self._entries))}"
        self._entries.append(LedgerEntry("", name, shard.bytes, shard.sha256, rows))

    def last_shard(self) -> Shard:
        """Write the rows that no shard has yet; gives the last shard."""
        self.flush()
        entry = self._entries[-1]
        return Shard(*self._item, entry.bytes, entry.checksum)

    @property
    def is_empty(self) -> bool:
        """Whether it has no row yet."""
        return self._count == 0

    def flush(self) -> None:
        """Write the rows that no shard has yet."""
        if not self._rows:
            return
        rows, self._rows = self._rows, []
        layout, shard = self._layout, len(self._entries)
        chunks = rows if self._holds_chunks else array_writer.encode_chunks(layout, np.stack(rows))
        file = array_writer.write_chunks(self._root, self.folder, layout, shard, len(rows), chunks)
        self._entries.append(LedgerEntry("", file.path, file.bytes, file.sha256, len(rows)))

    def finish(self) -> list[LedgerEntry]:
        """Write the last shard and the metadata; gives the entries of the shards, without keys."""
        self.flush()
        if self._entries:
            array_writer.create(self._root / self.folder, self._layout, root=self._root)
        return self._entries

    @property
    def _layout(self) -> Layout:
        shape, dtype = self._item
        if self._holds_chunks:
            return Layout((self._count, *shape), dtype, SHARD_ROWS, 1)
        return array_writer.plan_layout(self._count, shape, dtype, SHARD_ROWS)


def domain_arrays(root: Path, folder: str) -> dict[str, GrowingArray]:
    """The arrays of a trajectory's frames and source images in a domain, by the image's name."""
    names = {"rgb": False, "depth": False} | dict.fromkeys(SOURCE_IMAGES.values(), True)
    return {name: GrowingArray(root, f"{folder}/{name}", kind) for name, kind in names.items()}
