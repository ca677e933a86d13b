"""Renderer of the synthetic world's frames."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry.camera_offset import RenderChange
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtools.rendering.frame_renderer import FrameRenderer, RendererKind

if TYPE_CHECKING:
    from s2rtools.synthetic_world.dataset import WorldData


class WorldRenderer:
    """Renders either side of a world from its recipe; moves the real camera from its true pose."""

    domains: tuple[str, ...] = SIDES

    def __init__(self, store: Store, data: WorldData) -> None:
        self._data = data
        self._poses = {domain: store.poses(domain) for domain in self.domains}
        self._numbers = data.noise_numbers(store)

    def frames(
        self, domain: str, start: int, stop: int, move: RenderChange
    ) -> tuple[NDArray[np.uint8], NDArray[Any]]:
        side = next(side for side in SIDES if side == domain)
        rows = slice(start, stop)
        camera = self._data.camera(side).moved(move.height, move.pitch, move.zoom)
        views = self._data.views(
            side, self._poses[domain][rows], self._numbers[rows], camera,
            lights=(move.lamps, move.windows),
        )  # fmt: skip
        return views.rgb, self._data.raw_depth(views)

    def subsampled(
        self, domain: str, start: int, stop: int, move: RenderChange, stride: int
    ) -> tuple[NDArray[np.uint8], NDArray[Any]]:
        side = next(side for side in SIDES if side == domain)
        rows = slice(start, stop)
        camera = self._data.camera(side).moved(move.height, move.pitch, move.zoom)
        poses, every = self._poses[domain][rows], camera.subsampled(stride)
        views = self._data.views(
            side, poses, self._numbers[rows], every, samples=1, lights=(move.lamps, move.windows)
        )
        return views.rgb, self._data.raw_depth(views)


def _open(store: Store) -> FrameRenderer:
    from s2rtools.synthetic_world.dataset import WorldData

    data = WorldData.of_store(store)
    if data is None or not data.matches(store):
        raise RequestError(
            f"{store.path}: this version renders other images; ingest the world again"
        )
    return WorldRenderer(store, data)


WORLD = RendererKind("world", 1, lambda store: "recipe" in store.provenance("world"), _open)
