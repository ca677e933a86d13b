"""Read both sides' frames ahead of the computation and apply each side's adjustments."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.camera_offset import UNMOVED
from s2rstore.reader import Store
from s2rstore.records import SIDES, Domain, Run, Side
from s2rstore.run_inputs import FRAME_KINDS, run_camera_move
from s2rtools.adjustments import Chain, apply_chain
from s2rtools.common.read_ahead import map_ahead
from s2rtools.models.preprocessing import preprocess
from s2rtools.rendering import FrameRenderer, open_renderer

_READ_ROWS = 32

FrameImages = dict[str, NDArray[Any]]
RenderedArrays = Callable[[str, str], Any]
Renderers = dict[str, FrameRenderer]


@dataclass(frozen=True, slots=True, eq=False)
class SideFrames:
    """rgb (B, H, W, 3), raw depth (B, H, W), valid (B, H, W), network input x (B, 4, h, w)."""

    rgb: NDArray[np.uint8]
    depth: NDArray[Any]
    valid: NDArray[np.bool_]
    depth_scale: float
    x: NDArray[np.float32]

    def rows(self, rows: slice) -> SideFrames:
        return SideFrames(
            self.rgb[rows], self.depth[rows], self.valid[rows], self.depth_scale, self.x[rows]
        )


PairFrames = dict[Side, SideFrames]


class RunFrames:
    """Frames of a run's sides before image adjustments.

    They are read from the store. For a side whose cameras are moved, they are read from the run's
    rendered frames if available, else rendered.
    """

    def __init__(
        self,
        store: Store,
        run: Run,
        rendered: RenderedArrays | None = None,
        renderers: Renderers | None = None,
    ) -> None:
        """`rendered(kind, side)` opens the complete arrays of rendered frames.

        `renderers` caches open renderers by domain and may be shared between runs of a store.
        """
        self._store, self._run, self._rendered = store, run, rendered
        self._moves = {side: run_camera_move(store, run, side) for side in SIDES}
        self._renderers = {} if renderers is None else renderers

    def read(
        self, side: Side, start: int, stop: int, images: tuple[str, ...] = ("rgb", "depth")
    ) -> FrameImages:
        """Images of iids [start, stop), as `Store.frames` returns them."""
        domain, move = self._run.domain(side), self._moves[side]
        if move == UNMOVED:
            return self._store.frames(domain, start, stop, images)
        if self._rendered is not None:
            return {i: np.asarray(self._rendered(FRAME_KINDS[i], side)[start:stop]) for i in images}
        if domain not in self._renderers:
            self._renderers[domain] = open_renderer(self._store, domain)
        rgb, depth = self._renderers[domain].frames(domain, start, stop, move)
        return {"rgb": rgb, "depth": depth}


def read_pairs(
    store: Store,
    run: Run,
    input_size: tuple[int, int],
    start: int,
    stop: int,
    batch: int,
    frames: RunFrames | None = None,
) -> Iterator[tuple[int, PairFrames]]:
    """Batches of at most `batch` pairs of iids [start, stop), each with its first iid.

    A thread reads and prepares the next block while the caller computes.
    """
    source = frames or RunFrames(store, run)

    def prepare(low: int) -> PairFrames:
        return {
            side: side_frames(
                source.read(side, low, min(low + _READ_ROWS, stop)), store.domain(run.domain(side)),
                run.adjustments(side), input_size, store.path,
            )
            for side in SIDES
        }  # fmt: skip

    with ThreadPoolExecutor(1, thread_name_prefix="frames") as pool:
        blocks = range(start, stop, _READ_ROWS)
        for low, block in zip(blocks, map_ahead(pool, prepare, blocks, window=1), strict=True):
            for offset in range(0, len(block["sim"].x), batch):
                rows = slice(offset, offset + batch)
                yield low + offset, {side: frames.rows(rows) for side, frames in block.items()}


def side_frames(
    images: FrameImages,
    domain: Domain,
    chain: Chain,
    input_size: tuple[int, int],
    store_path: Path,
) -> SideFrames:
    """Network input of one side: its images after the chain's image adjustments."""
    rgb, depth = images["rgb"], images["depth"]
    valid = (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
    rgb, depth = apply_chain(rgb, depth, valid, chain, store_path)
    if chain:
        valid = valid & (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
    x = preprocess(rgb, depth, domain.depth_scale, input_size)
    return SideFrames(rgb, depth, valid, domain.depth_scale, x)
