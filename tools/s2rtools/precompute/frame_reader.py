"""Reading both sides' frames ahead of the computation, through each side's adjustments."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.camera_offset import UNMOVED
from s2rstore.reader import Store
from s2rstore.records import SIDES, Domain, Run, Side
from s2rstore.run_inputs import FRAME_KINDS, run_move
from s2rtools.adjustments import Chain, apply_chain
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


PairFrames = dict[Side, SideFrames]


class RunFrames:
    """The frames of a run's sides before the adjustments of images.

    Stored ones; of a side whose cameras are moved those that the run keeps, or rendered now.
    """

    def __init__(
        self,
        store: Store,
        run: Run,
        kept: RenderedArrays | None = None,
        renderers: Renderers | None = None,
    ) -> None:
        """`kept(kind, side)` gives the arrays of rendered frames, where they are complete.

        `renderers` are those that are open, by domain; it may be shared between runs of a store.
        """
        self._store, self._run, self._kept = store, run, kept
        self._moves = {side: run_move(store, run, side) for side in SIDES}
        self._renderers = {} if renderers is None else renderers

    def read(
        self, side: Side, start: int, stop: int, images: tuple[str, ...] = ("rgb", "depth")
    ) -> FrameImages:
        """The images of iids [start, stop), as `Store.frames` gives them."""
        domain, move = self._run.domain(side), self._moves[side]
        if move == UNMOVED:
            return self._store.frames(domain, start, stop, images)
        if self._kept is not None:
            return {i: np.asarray(self._kept(FRAME_KINDS[i], side)[start:stop]) for i in images}
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
    blocks = [(low, min(low + _READ_ROWS, stop)) for low in range(start, stop, _READ_ROWS)]

    def prepare(low: int, high: int) -> PairFrames:
        return {
            side: side_frames(
                source.read(side, low, high), store.domain(run.domain(side)),
                run.adjustments(side), input_size,
            )
            for side in SIDES
        }  # fmt: skip

    with ThreadPoolExecutor(1, thread_name_prefix="frames") as pool:
        ahead = pool.submit(prepare, *blocks[0]) if blocks else None
        for position, (low, high) in enumerate(blocks):
            assert ahead is not None
            block = ahead.result()
            if position + 1 < len(blocks):
                ahead = pool.submit(prepare, *blocks[position + 1])
            for offset in range(0, high - low, batch):
                cut = slice(offset, min(offset + batch, high - low))
                yield low + offset, {side: _cut(found, cut) for side, found in block.items()}


def side_frames(
    images: FrameImages, domain: Domain, chain: Chain, input_size: tuple[int, int]
) -> SideFrames:
    """What a network is given of one side: its images through the chain's image adjustments."""
    rgb, depth = images["rgb"], images["depth"]
    valid = (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
    rgb, depth = apply_chain(rgb, depth, valid, chain)
    if chain:
        valid = valid & (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
    x = preprocess(rgb, depth, domain.depth_scale, input_size)
    return SideFrames(rgb, depth, valid, domain.depth_scale, x)


def _cut(frames: SideFrames, cut: slice) -> SideFrames:
    return SideFrames(
        frames.rgb[cut], frames.depth[cut], frames.valid[cut], frames.depth_scale, frames.x[cut]
    )
