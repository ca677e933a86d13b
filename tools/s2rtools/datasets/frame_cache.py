"""Decoded frames on the disk, between the pass that checks them and the pass that stores them."""

from __future__ import annotations

import os
import threading
from dataclasses import dataclass, replace
from typing import IO, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Domain
from s2rtools.datasets.scan import DecodedFrame, Scan


class FrameOrigin(Protocol):
    """Where a cached frame came from; see `FrameSource`."""

    @property
    def pixels(self) -> int: ...

    def file_names(self, scan: Scan) -> tuple[str | None, str | None]: ...


class FrameCache:
    """One trajectory's frames in a temporary file; any thread may add and read.

    It takes at most 5 bytes per stored pixel and avoids decoding every image twice.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._descriptor = file.fileno()
        self._lock = threading.Lock()
        self._end = 0

    def add(self, source: FrameOrigin, frame: DecodedFrame) -> CachedFrame:
        """Store a frame; the returned source reads it from here."""
        depth = np.empty(0, dtype=np.uint8) if frame.depth is None else frame.depth
        content = frame.rgb.tobytes() + depth.tobytes()
        with self._lock:
            offset = self._end
            self._end += len(content)
        written = 0
        while written < len(content):
            written += os.pwrite(self._descriptor, content[written:], offset + written)
        empty = np.empty(0, dtype=np.uint8)
        shapes = frame.rgb.shape, depth.shape
        metadata = replace(frame, rgb=empty, depth=None)
        dtype = None if frame.depth is None else depth.dtype
        return CachedFrame(source, self, metadata, offset, shapes, dtype)

    def read(self, size: int, offset: int) -> bytearray:
        content = bytearray(size)
        done = 0
        while done < size:
            count = os.preadv(self._descriptor, [memoryview(content)[done:]], offset + done)
            if not count:
                raise OSError(0, "a temporary file was truncated")
            done += count
        return content


@dataclass(frozen=True, slots=True, eq=False)
class CachedFrame:
    """A `FrameSource` whose frame lies in a `FrameCache`; `depth_dtype` is None without depth."""

    source: FrameOrigin
    cache: FrameCache
    metadata: DecodedFrame
    offset: int
    shapes: tuple[tuple[int, ...], tuple[int, ...]]
    depth_dtype: np.dtype[Any] | None

    @property
    def pixels(self) -> int:
        return self.source.pixels

    def file_names(self, scan: Scan) -> tuple[str | None, str | None]:
        return self.source.file_names(scan)

    def checksum(self, scan: Scan, domain: Domain) -> str:
        return self.metadata.sha256

    def decode(self, scan: Scan, domain: Domain) -> DecodedFrame:
        rgb_shape, depth_shape = self.shapes
        split = int(np.prod(rgb_shape))
        itemsize = 0 if self.depth_dtype is None else self.depth_dtype.itemsize
        size = split + int(np.prod(depth_shape)) * itemsize
        content = self.cache.read(size, self.offset)
        rgb: NDArray[np.uint8] = np.frombuffer(content, np.uint8, split).reshape(rgb_shape)
        if self.depth_dtype is None:
            return replace(self.metadata, rgb=rgb)
        depth = np.frombuffer(content, self.depth_dtype, offset=split).reshape(depth_shape)
        return replace(self.metadata, rgb=rgb, depth=depth)
