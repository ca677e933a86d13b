"""Decoded views on the disk, between the pass that checks them and the pass that stores them."""

from __future__ import annotations

import os
import tempfile
import threading
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Domain
from s2rtools.datasets.scan import CheckedFrame, DecodedFrame, FrameSource, InputIssue, Scan


class ViewCache:
    """A nameless temporary file of one trajectory's views; any thread may add and read.

    It takes 5 bytes a stored pixel at most, and spares decoding every image twice.
    """

    def __init__(self, folder: Path) -> None:
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        self._lock = threading.Lock()
        self._end = 0

    def __enter__(self) -> ViewCache:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._file.close()

    def add(self, picture: FrameSource, view: DecodedFrame) -> CachedView:
        """The same picture, whose view is from now on read from here."""
        content = view.rgb.tobytes() + view.depth.tobytes()
        with self._lock:
            at = self._end
            self._end += len(content)
        written = 0
        while written < len(content):
            written += os.pwrite(self._file.fileno(), content[written:], at + written)
        nothing = np.empty(0, dtype=np.uint8)
        shapes = view.rgb.shape, view.depth.shape
        facts = replace(view, rgb=nothing, depth=nothing)
        return CachedView(picture, self, facts, at, shapes, view.depth.dtype)

    def read(self, size: int, at: int) -> bytearray:
        content = bytearray(size)
        done = 0
        while done < size:
            count = os.preadv(self._file.fileno(), [memoryview(content)[done:]], at + done)
            if not count:
                raise OSError(0, "a temporary file was cut")
            done += count
        return content


@dataclass(frozen=True, slots=True, eq=False)
class CachedView:
    """A `FrameSource` that was decoded already."""

    picture: FrameSource
    cache: ViewCache
    facts: DecodedFrame
    at: int
    shapes: tuple[tuple[int, ...], tuple[int, ...]]
    depth_dtype: np.dtype[Any]

    @property
    def pixels(self) -> int:
        return self.picture.pixels

    def files(self, scan: Scan) -> tuple[str | None, str | None]:
        return self.picture.files(scan)

    def check(self, scan: Scan, domain: Domain) -> CheckedFrame | InputIssue:
        return CheckedFrame(str(self.depth_dtype), self.facts.notes, self.view(scan, domain))

    def view(self, scan: Scan, domain: Domain) -> DecodedFrame:
        rgb_shape, depth_shape = self.shapes
        split = int(np.prod(rgb_shape))
        size = split + int(np.prod(depth_shape)) * self.depth_dtype.itemsize
        content = self.cache.read(size, self.at)
        rgb: NDArray[np.uint8] = np.frombuffer(content, np.uint8, split).reshape(rgb_shape)
        depth = np.frombuffer(content, self.depth_dtype, offset=split).reshape(depth_shape)
        return replace(self.facts, rgb=rgb, depth=depth)
