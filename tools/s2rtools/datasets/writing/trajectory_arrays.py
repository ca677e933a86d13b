"""The arrays of a trajectory's stored instances: those of each domain and image.

Shards are written as their rows come, the metadata last. Images at the size of their source, from
which the input of a network is made, lie in one compressed image per chunk; they are compressed in
the threads that decode, because that takes longest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import array_writer
from s2rstore.arrays.stored_array import shard_name
from s2rstore.arrays.zarr_metadata import Layout
from s2rstore.dataset_reader import SOURCE_IMAGES
from s2rstore.files.ledger import LedgerEntry
from s2rtools.datasets.scan import SourceImages
from s2rtools.datasets.writing.ingest_journal import SHARD_ROWS, Shard

Row = TypeVar("Row")

Plan = Callable[[int, tuple[int, ...], str], Layout]
"""The layout of an array of so many rows of a shape and a numpy type."""
Encode = Callable[[Layout, Sequence[Row]], Sequence[bytes]]
"""The compressed chunks of the rows of a shard."""


@dataclass(frozen=True, slots=True)
class CompressedImage:
    """One image as it lies in the array: its shape, its type and the bytes of its chunk."""

    shape: tuple[int, ...]
    dtype: str
    content: bytes

    @classmethod
    def of(cls, image: NDArray[Any]) -> CompressedImage:
        layout = _source_layout(1, image.shape, str(image.dtype))
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


class GrowingArray(Generic[Row]):
    """An array in `folder` inside `root`; `plan` and `encode` say how rows become chunks."""

    def __init__(self, root: Path, folder: str, plan: Plan, encode: Encode[Row]) -> None:
        self.folder = folder
        self._root, self._plan, self._encode = root, plan, encode
        self._rows: list[Row] = []
        self._count = 0
        self._entries: list[LedgerEntry] = []

    def add(self, row: Row, shape: tuple[int, ...], dtype: str) -> None:
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
        chunks, shard = self._encode(self._layout, rows), len(self._entries)
        file = array_writer.write_chunks(
            self._root, self.folder, self._layout, shard, len(rows), chunks
        )
        self._entries.append(LedgerEntry("", file.path, file.bytes, file.sha256, len(rows)))

    def finish(self) -> list[LedgerEntry]:
        """Write the last shard and the metadata; gives the entries of the shards, without keys."""
        self.flush()
        if self._entries:
            array_writer.create(self._root / self.folder, self._layout, root=self._root)
        return self._entries

    @property
    def _layout(self) -> Layout:
        return self._plan(self._count, *self._item)


def domain_arrays(root: Path, folder: str) -> dict[str, GrowingArray[Any]]:
    """The arrays of a trajectory's frames and source images in a domain, by the image's name."""
    frames = {image: _frame_array(root, f"{folder}/{image}") for image in ("rgb", "depth")}
    return frames | {
        image: _source_array(root, f"{folder}/{image}") for image in SOURCE_IMAGES.values()
    }


def _frame_array(root: Path, folder: str) -> GrowingArray[NDArray[Any]]:
    def plan(count: int, item: tuple[int, ...], dtype: str) -> Layout:
        return array_writer.plan_layout(count, item, dtype, SHARD_ROWS)

    def encode(layout: Layout, rows: Sequence[NDArray[Any]]) -> list[bytes]:
        return array_writer.encode_chunks(layout, np.stack(rows))

    return GrowingArray(root, folder, plan, encode)


def _source_array(root: Path, folder: str) -> GrowingArray[bytes]:
    """An array in `folder` inside `root` whose rows are the contents of compressed images."""
    return GrowingArray(root, folder, _source_layout, lambda layout, chunks: chunks)


def _source_layout(count: int, shape: tuple[int, ...], dtype: str) -> Layout:
    return Layout((count, *shape), dtype, SHARD_ROWS, 1)
