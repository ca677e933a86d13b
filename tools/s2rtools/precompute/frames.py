"""Reading both sides' frames ahead of the computation, through each side's adjustments."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store
from s2rstore.records import SIDES, Run, Side
from s2rtools.adjust import apply_chain
from s2rtools.models.preprocess import preprocess

_READ_ROWS = 32


@dataclass(frozen=True, slots=True, eq=False)
class SideFrames:
    """rgb (B, H, W, 3), raw depth (B, H, W), valid (B, H, W), network input x (B, 4, h, w)."""

    rgb: NDArray[np.uint8]
    depth: NDArray[Any]
    valid: NDArray[np.bool_]
    depth_scale: float
    x: NDArray[np.float32]


PairFrames = dict[Side, SideFrames]


def read_pairs(
    store: Store, run: Run, input_size: tuple[int, int], start: int, stop: int, batch: int
) -> Iterator[tuple[int, PairFrames]]:
    """Batches of at most `batch` pairs of iids [start, stop), each with its first iid.

    A thread reads and prepares the next block while the caller computes.
    """
    blocks = [(low, min(low + _READ_ROWS, stop)) for low in range(start, stop, _READ_ROWS)]

    def prepare(low: int, high: int) -> PairFrames:
        return {side: _side(store, run, side, input_size, low, high) for side in SIDES}

    with ThreadPoolExecutor(1, thread_name_prefix="frames") as pool:
        ahead = pool.submit(prepare, *blocks[0]) if blocks else None
        for position, (low, high) in enumerate(blocks):
            assert ahead is not None
            block = ahead.result()
            if position + 1 < len(blocks):
                ahead = pool.submit(prepare, *blocks[position + 1])
            for offset in range(0, high - low, batch):
                cut = slice(offset, min(offset + batch, high - low))
                yield low + offset, {side: _cut(frames, cut) for side, frames in block.items()}


def _side(
    store: Store, run: Run, side: Side, input_size: tuple[int, int], low: int, high: int
) -> SideFrames:
    domain = store.domains[run.domain(side)]
    images = store.frames(domain.domain, low, high)
    rgb, depth = images["rgb"], images["depth"]
    valid = (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
    rgb, depth = apply_chain(rgb, depth, valid, run.adjustments(side))
    if run.adjustments(side):
        valid = valid & (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
    x = preprocess(rgb, depth, domain.depth_scale, input_size)
    return SideFrames(rgb, depth, valid, domain.depth_scale, x)


def _cut(frames: SideFrames, cut: slice) -> SideFrames:
    return SideFrames(
        frames.rgb[cut], frames.depth[cut], frames.valid[cut], frames.depth_scale, frames.x[cut]
    )
