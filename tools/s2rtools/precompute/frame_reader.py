"""Read both sides' frames ahead of the computation and apply each side's adjustments."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.camera_offset import UNCHANGED
from s2rstore.reader import Store
from s2rstore.records import SIDES, Domain, Run, Side
from s2rstore.run_inputs import FRAME_KINDS, run_render_change
from s2rtools.adjustments import Chain, apply_chain
from s2rtools.common.read_ahead import map_ahead
from s2rtools.models.input_contract import InputContract
from s2rtools.models.preprocessing import preprocess
from s2rtools.synthetic_world.stored_world import WorldRenderer, open_renderer

_READ_ROWS = 32

FrameImages = dict[str, NDArray[Any]]
RenderedArrays = Callable[[str, str], Any]
Renderers = dict[str, WorldRenderer]


SourceBlock = dict[str, NDArray[Any]]
"""rgb (n, H, W, 3) and raw depth (n, H', W') of consecutive instances, at the source's size."""


AdjustedImages = tuple[NDArray[np.uint8], NDArray[Any], NDArray[np.bool_]]
"""RGB, raw depth and its validity after the image adjustments."""


@dataclass(frozen=True, eq=False)
class SideFrames:
    """One side of B instances: the network input x (B, C, h, w), and its images of the frame size.

    x is made from the images at the size of their source where `RunFrames.read_source` gives them,
    else from `images`, which are those of the frame size before the adjustments of `chain`; `known`
    are those after it, if they are computed already.
    """

    images: FrameImages
    domain: Domain
    chain: Chain
    store_path: Path
    x: NDArray[np.float32]
    known: AdjustedImages | None = None

    @cached_property
    def adjusted(self) -> AdjustedImages:
        """rgb (B, H, W, 3), raw depth (B, H, W) and valid (B, H, W), of the frame size."""
        return self.known or adjusted_images(self.images, self.domain, self.chain, self.store_path)

    @property
    def rgb(self) -> NDArray[np.uint8]:
        return self.adjusted[0]

    @property
    def depth(self) -> NDArray[Any]:
        return self.adjusted[1]

    @property
    def valid(self) -> NDArray[np.bool_]:
        return self.adjusted[2]

    def rows(self, rows: slice) -> SideFrames:
        images = {name: each[rows] for name, each in self.images.items()}
        known = None
        if self.known is not None:
            rgb, depth, valid = self.known
            known = rgb[rows], depth[rows], valid[rows]
        return replace(self, images=images, x=self.x[rows], known=known)


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
        self._moves = {side: run_render_change(store, run, side) for side in SIDES}
        self._renderers = {} if renderers is None else renderers

    def read(
        self, side: Side, start: int, stop: int, images: tuple[str, ...] = ("rgb", "depth")
    ) -> FrameImages:
        """Images of iids [start, stop), as `Store.frames` returns them."""
        domain, move = self._run.domain(side), self._moves[side]
        if move == UNCHANGED:
            return self._store.frames(domain, start, stop, images)
        if self._rendered is not None:
            return {i: np.asarray(self._rendered(FRAME_KINDS[i], side)[start:stop]) for i in images}
        if domain not in self._renderers:
            self._renderers[domain] = open_renderer(self._store, domain)
        rgb, depth = self._renderers[domain].frames(domain, start, stop, move)
        return {"rgb": rgb, "depth": depth}

    def read_source(self, side: Side, start: int, stop: int) -> list[SourceBlock] | None:
        """The images of iids [start, stop) at the size of their source.

        None where the network gets those that `read` gives: the store holds no others, or they
        are rendered.
        """
        domain = self._run.domain(side)
        if self._moves[side] != UNCHANGED:
            return None
        return read_source(self._store, domain, start, stop)


def read_pairs(
    store: Store,
    run: Run,
    contract: InputContract,
    start: int,
    stop: int,
    batch: int,
    frames: RunFrames | None = None,
    sides: Sequence[Side] = SIDES,
) -> Iterator[tuple[int, PairFrames]]:
    """Batches of at most `batch` instances of iids [start, stop), each with its first iid.

    They hold the frames of `sides`, by default pairs. A thread reads and prepares the next block
    while the caller computes.
    """
    source = frames or RunFrames(store, run)

    def prepare(low: int) -> PairFrames:
        high = min(low + _READ_ROWS, stop)
        return {
            side: side_frames(
                source.read(side, low, high), store.domain(run.domain(side)),
                run.adjustments(side), contract, store.path, source.read_source(side, low, high),
            )
            for side in sides
        }  # fmt: skip

    with ThreadPoolExecutor(1, thread_name_prefix="frames") as pool:
        blocks = range(start, stop, _READ_ROWS)
        for low, block in zip(blocks, map_ahead(pool, prepare, blocks, window=1), strict=True):
            for offset in range(0, len(next(iter(block.values())).x), batch):
                rows = slice(offset, offset + batch)
                yield low + offset, {side: frames.rows(rows) for side, frames in block.items()}


def read_source(store: Store, domain: str, start: int, stop: int) -> list[SourceBlock] | None:
    """A domain's images of iids [start, stop) at the size of their source.

    None where the store holds no others than `Store.frames` gives.
    """
    if not store.has_source_images(domain, start, stop):
        return None
    return [block for _, block in store.source_frames(domain, start, stop)]


def side_frames(
    images: FrameImages,
    domain: Domain,
    chain: Chain,
    contract: InputContract,
    store_path: Path,
    source: Sequence[SourceBlock] | None = None,
) -> SideFrames:
    """Network input of one side: its images after the chain's image adjustments.

    `images` have the frame size, `source` are the same ones at the size of their source, by default
    `images`. The chain is applied to `source` for the network, and apart from that to `images`.
    """
    known = None
    if source is None:
        known = adjusted_images(images, domain, chain, store_path)
        adjusted = [known]
    else:
        width = images["rgb"].shape[2]
        adjusted = [adjusted_images(each, domain, chain, store_path, width) for each in source]
    x = [preprocess(r, d, domain.depth_scale, contract, valid) for r, d, valid in adjusted]
    return SideFrames(images, domain, chain, store_path, np.concatenate(x), known)


def adjusted_images(
    images: SourceBlock, domain: Domain, chain: Chain, store_path: Path, frame_width: int = 0
) -> AdjustedImages:
    """Images after the chain's image adjustments.

    `frame_width` is that of the stored frame, by default of these images.
    """
    rgb, depth = images["rgb"], images["depth"]
    valid = _is_valid(depth, domain)
    enlargement = depth.shape[2] / (frame_width or depth.shape[2])
    rgb, depth = apply_chain(rgb, depth, valid, chain, store_path, enlargement)
    return rgb, depth, _is_valid(depth, domain) if chain else valid


def _is_valid(depth: NDArray[Any], domain: Domain) -> NDArray[np.bool_]:
    valid: NDArray[np.bool_] = (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
    return valid
