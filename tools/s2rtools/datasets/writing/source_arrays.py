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
from s2rtools.datasets.scan import SourceImages
from s2rtools.datasets.writing.growing_array import GrowingArray
from s2rtools.datasets.writing.ingest_journal import SHARD_ROWS


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


def source_array(root: Path, folder: str) -> GrowingArray[bytes]:
    """An array in `folder` inside `root` whose rows are the contents of compressed images."""
    return GrowingArray(root, folder, _layout, lambda layout, chunks: chunks)


def _layout(count: int, shape: tuple[int, ...], dtype: str) -> Layout:
    return Layout((count, *shape), dtype, SHARD_ROWS, 1)
