"""Renders the frames of a store of the synthetic world with moved cameras and other lights."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry.camera_offset import RenderChange
from s2rstore.reader import Store
from s2rstore.records import SIDES

if TYPE_CHECKING:
    from s2rtools.synthetic_world.dataset import WorldData
    from s2rtools.synthetic_world.routes import Poses

VERSION = 1
"""Changes whenever the frames of moved cameras do; a part of the key of rendered frames."""
Frames = tuple[NDArray[np.uint8], NDArray[Any]]
"""RGB (n, H, W, 3) and raw depth (n, H, W), as they are stored."""


class WorldRenderer:
    """Renders either side of a world from its recipe; moves the real camera from its true pose."""

    def __init__(self, store: Store, data: WorldData) -> None:
        self._data = data
        self._poses: dict[str, Poses] = {domain: store.poses(domain) for domain in SIDES}
        self._numbers = data.noise_numbers(store)

    def frames(
        self, domain: str, start: int, stop: int, change: RenderChange, stride: int = 1
    ) -> Frames:
        """The frames of iids [start, stop), of every `stride`-th row and column.

        With a stride above 1 a colour is that of the centre of its pixel, in less time.
        """
        side = next(side for side in SIDES if side == domain)
        rows = slice(start, stop)
        camera = self._data.camera(side).moved(change.height, change.pitch, change.zoom)
        lights = change.lamps, change.windows
        poses, numbers = self._poses[domain][rows], self._numbers[rows]
        if stride == 1:
            views = self._data.views(side, poses, numbers, camera, lights=lights)
        else:
            camera = camera.subsampled(stride)
            views = self._data.views(side, poses, numbers, camera, samples=1, lights=lights)
        return views.rgb, self._data.raw_depth(views)


def no_renderer_reason(store: Store) -> str | None:
    """Why a store's cameras cannot be moved; None if they can. Fast."""
    if _is_world(store):
        return None
    return f"{store.path}: its images were taken, not rendered; cameras cannot be moved"


def open_renderer(store: Store, domain: str) -> WorldRenderer:
    """The renderer of a store's domain; this may take seconds.

    Raises RequestError if the store is not of the synthetic world, if this version renders other
    frames than those of the store, or if the domain is not rendered.
    """
    from s2rtools.synthetic_world.dataset import WorldData

    if reason := no_renderer_reason(store):
        raise RequestError(reason)
    data = WorldData.of_store(store)
    if data is None or not data.matches(store):
        raise RequestError(
            f"{store.path}: this version renders other images; ingest the world again"
        )
    if domain not in SIDES:
        known = ", ".join(SIDES)
        raise RequestError(f"domain {domain!r}: cannot be rendered (only {known})")
    return WorldRenderer(store, data)


def renderer_version(store: Store) -> str:
    """Name and version of a store's renderer, a part of the key of rendered frames."""
    return f"world {VERSION}" if _is_world(store) else "none"


def _is_world(store: Store) -> bool:
    return "recipe" in store.provenance("world")
