"""Images without depth on the disk, until they are stored."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from s2rstore.records import Domain
from s2rtools.common.lazy_sequence import RowFile
from s2rtools.datasets.scan import DecodedFrame, Scan


class FrameOrigin(Protocol):
    """Where a cached frame came from: the name and the pixels of the image."""

    @property
    def pixels(self) -> int: ...

    @property
    def name(self) -> str | None: ...


class FrameCache:
    """Frames without depth in temporary files; any thread may add and read.

    A frame takes 16 bytes of memory, and 3 bytes per pixel on the disk.
    """

    def __init__(self) -> None:
        self._facts, self._images = RowFile(), RowFile()

    def add(self, source: FrameOrigin, frame: DecodedFrame) -> int:
        """Store a frame; gives its number."""
        self._images.append(frame.rgb.shape, frame.rgb.tobytes())
        return self._facts.append(source.name, source.pixels, frame.sha256)

    def source(self, number: int) -> CachedFrame:
        """The source that reads a frame from here."""
        name, pixels, sha256 = self._facts[number]
        return CachedFrame(self, number, name, pixels, sha256)

    def frame(self, number: int, sha256: str) -> DecodedFrame:
        shape, rgb = self._images[number]
        return DecodedFrame(np.frombuffer(rgb, np.uint8).reshape(shape), None, sha256, math.nan)


@dataclass(frozen=True, slots=True, eq=False)
class CachedFrame:
    """A `FrameSource` whose frame lies in a `FrameCache`."""

    cache: FrameCache
    number: int
    name: str | None
    pixels: int
    sha256: str

    def file_names(self, scan: Scan) -> tuple[str | None, str | None]:
        return self.name, None

    def checksum(self, scan: Scan, domain: Domain) -> str:
        return self.sha256

    def decode(self, scan: Scan, domain: Domain) -> DecodedFrame:
        return self.cache.frame(self.number, self.sha256)
