"""Where the images of one topic lie in a bag, in the order of their stamps."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError, counted
from s2rtools.common.bag_files import refusing_damage
from s2rtools.common.bag_messages import BagMessages, stamp_of
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.bags import image_messages
from s2rtools.datasets.bags.camera_poses import plain
from s2rtools.datasets.files.image_decoding import type_of_bits
from s2rtools.datasets.recording import SourceImage


class ImageIndex:
    """Recording time, stamp, size and bits of each image of a topic; 40 bytes each.

    Times are those of the headers, or those of the recording where all headers have 0.
    """

    def __init__(self, bag: BagMessages, topic: str) -> None:
        self.bag, self.topic = bag, topic
        self.frames: set[str] = set()
        self.in_metres = False
        self._rows = array("q")
        self.times: NDArray[np.int64] = np.zeros(0, np.int64)
        """Nanoseconds, ascending; empty before `finish`."""
        self.issues: list[InputIssue] = []

    def add(self, recorded: int, message: Any) -> None:
        declared = image_messages.declared(message)
        self.in_metres |= declared.in_metres
        self._rows.extend((recorded, stamp_of(message), *declared.size, declared.bits))
        self.frames.add(plain(message.header.frame_id))

    def finish(self) -> None:
        """Sort by time; images with the time of another are left out and reported."""
        table = np.frombuffer(self._rows, dtype=np.int64).reshape(-1, 5)
        has_stamps = bool(table[:, 1].any())
        times = table[:, 1 if has_stamps else 0]
        late = int((np.diff(times) < 0).sum())
        if late:
            detail = f"{late} of {len(times)} before the one in front of them; sorted"
            self.issues.append(InputIssue("unordered stamps", self._place, detail))
        self.times, first = np.unique(times, return_index=True)
        if len(first) < len(times):
            again = counted(len(times) - len(first), "image")
            detail = f"left out: {again} with the stamp of another"
            self.issues.append(InputIssue("repeated stamps", self._place, detail))
        self._table = table[first]
        self._rows = array("q")

    def common_size(self) -> tuple[int, int]:
        """The (height, width) of most images. Raises RequestError if all are unreadable."""
        sizes, counts = np.unique(self._table[:, 2:4], axis=0, return_counts=True)
        readable = sizes.all(axis=1)
        if not readable.any():
            raise RequestError(f"{self.bag.path}: topic {self.topic}: no image can be decoded")
        height, width = sizes[np.argmax(np.where(readable, counts, 0))].tolist()
        return height, width

    def image(self, row: int, is_depth: bool, size: tuple[int, int]) -> BagImage:
        """The image of a row, whose (height, width) must be `size`."""
        recorded, stamp, height, width, bits = self._table[row].tolist()
        name = self.name(row)
        return BagImage(self, recorded, stamp, name, height * width, is_depth, size, bits)

    def name(self, row: int) -> str:
        return f"{self._place}:{self.times[row]}"

    @property
    def _place(self) -> str:
        return f"{self.bag.path.name}:{self.topic}"


@dataclass(frozen=True, slots=True)
class BagImage:
    """An image of a bag that has not been decoded; see `recording.RecordedImage`."""

    index: ImageIndex
    recorded: int
    stamp: int
    name: str
    pixels: int
    is_depth: bool
    size: tuple[int, int]
    bits: int

    @property
    def declared_type(self) -> str:
        return type_of_bits(self.bits)

    @property
    def files(self) -> tuple[Path, ...]:
        return (self.index.bag.path,)

    def checksum(self) -> str | None:
        try:
            with refusing_damage(self.index.bag.path):
                return image_messages.checksum(self._message())
        except RequestError:
            return None

    def read(self) -> SourceImage | InputIssue:
        try:
            with refusing_damage(self.index.bag.path):
                decode = image_messages.decode_depth if self.is_depth else image_messages.decode_rgb
                return decode(self._message(), self.name, self.size)
        except RequestError as error:
            return InputIssue("unreadable image", self.name, str(error))

    def _message(self) -> Any:
        return self.index.bag.at(self.index.topic, self.recorded, self.stamp)
