"""Write images at the size of their source, one compressed image per chunk.

The input of a network is made from them, so that each network can have its own way of resizing.
They are compressed in the threads that decode, because that takes longest.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from s2rstore.arrays import array_writer
from s2rstore.arrays.zarr_metadata import ITEM_BYTES, Layout
from s2rstore.dataset_reader import SOURCE_IMAGES
from s2rstore.files.ledger import LedgerEntry
from s2rtools.datasets.scan import SourceImages

SHARD_ROWS = 64


@dataclass(frozen=True, slots=True)
class CompressedImage:
    """One image as it lies in the array: its shape, its type and the bytes of its chunk."""

    shape: tuple[int, ...]
    dtype: str
    content: bytes

    @classmethod
    def of(cls, image: NDArray[Any]) -> CompressedImage:
        layout = _layout(1, image.shape, str(image.dtype))
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


def is_storable(source: SourceImages) -> bool:
    """Whether an array can hold such images."""
    depth = 0 if source.depth is None else source.depth.nbytes
    return max(source.rgb.nbytes, depth) <= ITEM_BYTES


def sizes(images: CompressedImages) -> tuple[tuple[int, ...], ...]:
    """Rows and columns of the images of a frame; equal in all frames of an array."""
    return tuple(image.shape[:2] for image in images.values())


class SourceArray:
    """An array of images whose shards are written as its rows come."""

    def __init__(self, root: Path, folder: str) -> None:
        self.folder = folder
        self._root = root
        self._chunks: list[bytes] = []
        self._count = 0
        self._entries: list[LedgerEntry] = []

    def add(self, image: CompressedImage) -> None:
        self._count += 1
        self._chunks.append(image.content)
        self._item = image.shape, image.dtype
        if len(self._chunks) == SHARD_ROWS:
            self._write_shard()

    def finish(self) -> list[LedgerEntry]:
        """Write the last shard and the metadata; gives the entries of the shards, without keys."""
        if self._chunks:
            self._write_shard()
        if self._entries:
            layout = _layout(self._count, *self._item)
            array_writer.create(self._root / self.folder, layout, root=self._root)
        return self._entries

    def _write_shard(self) -> None:
        chunks, self._chunks = self._chunks, []
        layout, shard = _layout(self._count, *self._item), len(self._entries)
        file = array_writer.write_chunks(
            self._root, self.folder, layout, shard, len(chunks), chunks
        )
        self._entries.append(LedgerEntry("", file.path, file.bytes, file.sha256, len(chunks)))


def _layout(count: int, shape: tuple[int, ...], dtype: str) -> Layout:
    return Layout((count, *shape), dtype, SHARD_ROWS, 1)
