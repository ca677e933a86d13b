"""Training images: the frames of every domain at the network's input size."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Side
from s2rtools.models.preprocessing import preprocess, resize_frames


@dataclass(frozen=True, slots=True, eq=False)
class DomainFrames:
    """All N frames of one domain at one size: rgb (N, h, w, 3) uint8, raw depth (N, h, w).

    Metres = raw * `depth_scale`.
    """

    kind: Side
    rgb: NDArray[np.uint8]
    depth: NDArray[Any]
    depth_scale: float

    @classmethod
    def from_blocks(
        cls,
        kind: Side,
        blocks: Iterable[tuple[NDArray[np.uint8], NDArray[Any]]],
        count: int,
        size: tuple[int, int],
        depth_scale: float,
    ) -> DomainFrames:
        """Resize blocks of (rgb, depth) in iid order.

        Raises ValueError if the blocks do not add up to `count` frames.
        """
        rgb: NDArray[np.uint8] | None = None
        depth: NDArray[Any] | None = None
        start = 0
        for block in blocks:
            small_rgb, small_depth = resize_frames(*block, size)
            if rgb is None or depth is None:
                rgb = np.empty((count, *size, 3), small_rgb.dtype)
                depth = np.empty((count, *size), small_depth.dtype)
            stop = start + len(small_rgb)
            rgb[start:stop], depth[start:stop] = small_rgb, small_depth
            start = stop
        if rgb is None or depth is None or start != count:
            raise ValueError(f"{start} frames, expected {count}")
        return cls(kind, rgb, depth, depth_scale)

    def inputs(self, rows: NDArray[np.intp]) -> NDArray[np.float32]:
        """Network input of some rows, (B, 4, h, w) in [-1, 1]."""
        size = (int(self.rgb.shape[1]), int(self.rgb.shape[2]))
        return preprocess(self.rgb[rows], self.depth[rows], self.depth_scale, size)


@dataclass(frozen=True, slots=True, eq=False)
class TrainingFrames:
    """Domains by name, poses (N, 3) x, y in metres, heading in radians, trajectory codes (N,).

    Row i is iid i; rows of one trajectory are contiguous, in recording order.
    """

    domains: dict[str, DomainFrames]
    poses: NDArray[np.float64]
    trajectory: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.poses)
