"""Images of one side of a run before its image adjustments, kept in memory by camera position."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.camera_offset import RenderChange, render_change
from s2rstore.lru_cache import LruCache
from s2rstore.reader import Store
from s2rstore.records import Domain, Run, Side
from s2rtools.adjustments import Chain
from s2rtools.models.input_contract import InputContract
from s2rtools.precompute.frame_reader import (
    FrameImages,
    Renderers,
    RunFrames,
    SourceBlock,
    adjusted_images,
    side_frames,
)
from s2rtools.synthetic_world.stored_world import open_renderer

_CACHE_BYTES = 256 << 20
BLOCK = 16
"""Instances that are adjusted and passed through a network at once."""

Adjusted = tuple[NDArray[np.uint8], NDArray[Any], NDArray[np.bool_]]


@dataclass(frozen=True, slots=True, eq=False)
class _Block:
    """Images of some instances, of the frame size and of the size of their source."""

    images: FrameImages
    source: list[SourceBlock] | None

    @property
    def nbytes(self) -> int:
        every = [self.images, *(self.source or [])]
        return sum(image.nbytes for each in every for image in each.values())


class SideImages:
    """The images of chosen instances on one side of a run, under any chain of that side.

    They are read from the store, or rendered where a chain moves the camera. Images before their
    adjustments stay in memory, up to a limit. With a `stride`, only every `stride`-th row and
    column of the stored frames counts, and rendered images have no other pixels.
    """

    def __init__(
        self, store: Store, run: Run, side: Side, iids: NDArray[np.int64],
        renderers: Renderers | None = None, stride: int = 1, rendered: bool = False,
    ) -> None:  # fmt: skip
        """`renderers` are those that are open already, by domain.

        Where `rendered`, images of cameras that are not moved are rendered, too, so that those of
        all cameras are made in the same way.
        """
        self._stride, self._rendered = stride, rendered
        self.store, self.run, self.side, self.iids = store, run, side, iids
        self._renderers: Renderers = {} if renderers is None else renderers
        self._domain = store.domain(run.domain(side))
        self._cache = LruCache(_CACHE_BYTES, lambda block: block.nbytes)

    def move(self, chain: Chain) -> RenderChange:
        """What a chain changes in rendering. Raises RequestError for an impossible camera."""
        return render_change(chain, self._domain, self.store.dataset.frame_width)

    def domain(self, chain: Chain) -> Domain:
        """The domain with its cameras as the chain moves them."""
        return self.move(chain).applied(self._domain)

    def adjusted(self, chain: Chain) -> Iterator[tuple[slice, Adjusted]]:
        """Rows, and RGB (b, H, W, 3), raw depth (b, H, W) and validity of the stored frames."""
        for rows, block in self._blocks(chain):
            width = self.store.dataset.frame_width
            yield rows, adjusted_images(block.images, self._domain, chain, self.store.path, width)

    @property
    def truth(self) -> NDArray[np.float64]:
        """The poses (n, 3): x, y in metres, heading in radians."""
        return self.store.poses(self.run.domain(self.side))[self.iids]

    def inputs(self, chain: Chain, contract: InputContract) -> Iterator[NDArray[np.float32]]:
        """The network's inputs (b, C, h, w), one block after the other."""
        for _, block in self._blocks(chain):
            yield side_frames(
                block.images, self._domain, chain, contract, self.store.path, block.source
            ).x

    def _blocks(self, chain: Chain) -> Iterator[tuple[slice, _Block]]:
        move = self.move(chain)
        for start in range(0, self.iids.size, BLOCK):
            rows = slice(start, min(start + BLOCK, self.iids.size))
            yield rows, self._cache.get((move, start), partial(self._read, rows, chain))

    def _read(self, rows: slice, chain: Chain) -> _Block:
        steps = [dict(step) for step in chain]
        if self.side == "sim":
            run = replace(self.run, sim_adjustments=steps)
        else:
            run = replace(self.run, real_adjustments=steps)
        frames = RunFrames(self.store, run, renderers=self._renderers)
        images: list[FrameImages] = []
        sources: list[list[SourceBlock] | None] = []
        for iid in self.iids[rows].tolist():
            if self._rendered:
                images.append(self._render(iid, chain))
                sources.append(None)
                continue
            read = frames.read(self.side, iid, iid + 1)
            images.append({name: each[:, :: self._stride, :: self._stride]
                           for name, each in read.items()})  # fmt: skip
            sources.append(frames.read_source(self.side, iid, iid + 1))
        joined = {name: np.concatenate([each[name] for each in images]) for name in images[0]}
        return _Block(joined, _joined_sources(sources))

    def _render(self, iid: int, chain: Chain) -> FrameImages:
        domain = self._domain.domain
        if domain not in self._renderers:
            self._renderers[domain] = open_renderer(self.store, domain)
        renderer = self._renderers[domain]
        rgb, depth = renderer.frames(domain, iid, iid + 1, self.move(chain), self._stride)
        return {"rgb": rgb, "depth": depth}


def _joined_sources(sources: Sequence[list[SourceBlock] | None]) -> list[SourceBlock] | None:
    """The source images of all instances; None where the network gets the stored frames."""
    if sources[0] is None:
        return None
    return [block for each in sources if each is not None for block in each]
