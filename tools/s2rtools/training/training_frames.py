"""Training images: the frames of domains at the network's input size, outside of memory."""

from __future__ import annotations

import os
import weakref
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.records import Side
from s2rtools.models.input_contract import InputContract
from s2rtools.models.preprocessing import preprocess, resize

Images = tuple[NDArray[np.uint8], NDArray[Any]]
"""rgb (n, H, W, 3) and raw depth (n, H, W)."""


class DomainFrames(Protocol):
    """The frames of one domain, one per instance."""

    @property
    def kind(self) -> Side: ...

    def inputs(self, rows: NDArray[np.intp]) -> NDArray[np.float32]:
        """The network input (B, C, h, w) of B rows, as the contract states."""


@dataclass(frozen=True, slots=True, eq=False)
class CopiedFrames:
    """All N frames of one domain at the size of a network: rgb (N, h, w, 3), raw depth (N, h, w).

    Metres = raw * `depth_scale`. Any order of rows is read equally fast.
    """

    kind: Side
    rgb: NDArray[np.uint8] | DiskArray
    depth: NDArray[Any] | DiskArray
    depth_scale: float
    contract: InputContract

    @classmethod
    def from_blocks(
        cls,
        kind: Side,
        blocks: Iterable[Images],
        count: int,
        contract: InputContract,
        depth_scale: float,
        folder: Path | None = None,
    ) -> CopiedFrames:
        """Resize blocks in iid order and copy them to temporary files in a folder.

        Raises ValueError if the blocks do not add up to `count` frames, RequestError where the
        folder has no space.
        """
        copies: tuple[DiskArray, DiskArray] | None = None
        for block in blocks:
            images = (
                resize(block[0], contract.size, contract.rgb_interpolation),
                resize(block[1], contract.size, contract.depth_interpolation),
            )
            if copies is None:
                rgb, depth = (DiskArray(each.shape[1:], each.dtype, folder) for each in images)
                copies = rgb, depth
            for copy, each in zip(copies, images, strict=True):
                copy.append(each)
        rows = 0 if copies is None else len(copies[0])
        if copies is None or rows != count:
            raise ValueError(f"{rows} frames, expected {count}")
        return cls(kind, *copies, depth_scale, contract)

    def inputs(self, rows: NDArray[np.intp]) -> NDArray[np.float32]:
        """The network input (B, C, h, w) of B rows, as the contract states."""
        return preprocess(self.rgb[rows], self.depth[rows], self.depth_scale, self.contract)


@dataclass(frozen=True, slots=True, eq=False)
class StreamedFrames:
    """The frames of one domain, read when they are needed.

    `read(start, stop)` gives consecutive images in blocks of one size; neighbouring rows are best
    requested together.
    """

    kind: Side
    read: Callable[[int, int], Iterable[Images]]
    contract: InputContract
    depth_scale: float

    def inputs(self, rows: NDArray[np.intp]) -> NDArray[np.float32]:
        """The network input (B, C, h, w) of B rows, as the contract states."""
        x = np.empty((len(rows), *self.contract.shape), dtype=np.float32)
        starts = np.flatnonzero(np.diff(rows, prepend=-2) != 1)
        for start, stop in pairwise([*starts.tolist(), len(rows)]):
            for images in self.read(int(rows[start]), int(rows[stop - 1]) + 1):
                part = preprocess(*images, self.depth_scale, self.contract)
                x[start : start + len(part)] = part
                start += len(part)
        return x


class DiskArray:
    """An array (N, *item) in a temporary file that grows by blocks and is read by rows."""

    def __init__(self, item: tuple[int, ...], dtype: np.dtype[Any], folder: Path | None) -> None:
        self._item, self._dtype = item, dtype
        self._bytes = int(np.prod(item)) * dtype.itemsize
        self._folder, self._count = folder, 0
        self._file = TemporaryFile(dir=folder)  # noqa: SIM115, closed with the last reference
        weakref.finalize(self, self._file.close)

    def __len__(self) -> int:
        return self._count

    @property
    def shape(self) -> tuple[int, ...]:
        return self._count, *self._item

    @property
    def dtype(self) -> np.dtype[Any]:
        return self._dtype

    def append(self, rows: NDArray[Any]) -> None:
        """Add rows (n, *item). Raises RequestError where the disk is full."""
        try:
            self._file.write(np.ascontiguousarray(rows, dtype=self._dtype).data)
            self._file.flush()
        except OSError as error:
            where = self._folder or "the folder of temporary files"
            reason = f"training images cannot be copied there ({error.strerror})"
            raise RequestError(f"{where}: {reason}") from error
        self._count += len(rows)

    def __getitem__(self, rows: NDArray[np.intp]) -> NDArray[Any]:
        """Some rows, in their order."""
        values = np.empty((len(rows), *self._item), dtype=self._dtype)
        for value, row in zip(values, rows.tolist(), strict=True):
            if not 0 <= row < self._count:
                raise IndexError(f"row {row} of {self._count}")
            if os.preadv(self._file.fileno(), [value.data], row * self._bytes) != self._bytes:
                raise RequestError("a temporary file of training images was truncated; train again")
        return values


@dataclass(frozen=True, slots=True, eq=False)
class TrainingFrames:
    """Domains by name, poses (N, 3) x, y in metres, heading in radians, trajectory codes (N,).

    Row i is iid i; rows of one trajectory are in recording order. `own_poses` are those of domains
    whose frames have other poses (N, 3) than the instances. `imaged` (N,) are the instances that a
    domain has frames of, where it lacks some; the others are black and belong to no split.
    """

    domains: dict[str, DomainFrames]
    poses: NDArray[np.float64]
    trajectory: NDArray[np.int32]
    own_poses: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    imaged: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)

    def truth(self, domain: str) -> NDArray[np.float64]:
        """The true poses of a domain's frames, (N, 3)."""
        return self.own_poses.get(domain, self.poses)

    def __len__(self) -> int:
        return len(self.poses)
