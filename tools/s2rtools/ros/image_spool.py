"""Images of a bag and their translations in a temporary file, until a store is made of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from tempfile import TemporaryFile
from typing import IO

import numpy as np

from s2rtools.translation.image_set import Rgb


@dataclass(slots=True)
class ImageSpool:
    """Pairs of images in the order in which they were added; one pair at a time is in memory."""

    _file: IO[bytes] = field(default_factory=TemporaryFile)
    _stamps: list[int] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self._stamps)

    def close(self) -> None:
        """Remove the file."""
        self._file.close()

    def add(self, stamp: int, original: Rgb, translated: Rgb) -> None:
        """Append two images (H, W, 3) uint8 with their stamp in nanoseconds."""
        for image in (original, translated):
            np.save(self._file, image, allow_pickle=False)
        self._stamps.append(stamp)

    def __iter__(self) -> Iterator[tuple[int, Rgb, Rgb]]:
        self._file.seek(0)
        for stamp in self._stamps:
            original, translated = (np.load(self._file, allow_pickle=False) for _ in range(2))
            yield stamp, original, translated
        self._file.seek(0, 2)
