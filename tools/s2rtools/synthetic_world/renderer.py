"""Render a scene: poses and a camera in; RGB, depth and object ids out."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from s2rstore.records import Intrinsics
from s2rtools.synthetic_world import raycaster
from s2rtools.synthetic_world.scene_geometry import (
    Lamp,
    ScenePart,
    WorldScene,
    footprint,
    pack_scene,
)

LIGHT_CELL = 0.1
SAMPLES = 2
_PLAN_HEIGHT = 2.05
_KERNEL_LOCK = threading.Lock()
"""numba's simplest threading layer must not be entered by two threads at once."""


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera: frame (height, width), height above the floor in metres."""

    frame: tuple[int, int]
    lens: Intrinsics
    height: float
    forward_offset: float = 0.0

    def moved(
        self, height: float = 0.0, pitch: float = 0.0, zoom: float = 1.0, forward: float = 0.0
    ) -> Camera:
        """The camera moved by metres, pitched up by radians, with `zoom` times the focal length."""
        lens = replace(
            self.lens, fx=self.lens.fx * zoom, fy=self.lens.fy * zoom,
            pitch=self.lens.pitch + pitch,
        )  # fmt: skip
        return replace(
            self, lens=lens, height=self.height + height,
            forward_offset=self.forward_offset + forward,
        )  # fmt: skip

    def subsampled(self, stride: int) -> Camera:
        """The camera of every `stride`-th pixel, through whose centres its pixels' rays pass."""
        shift = (stride - 1) / 2
        lens = replace(
            self.lens, fx=self.lens.fx / stride, fy=self.lens.fy / stride,
            cx=(self.lens.cx + shift) / stride, cy=(self.lens.cy + shift) / stride,
        )  # fmt: skip
        frame = -(-self.frame[0] // stride), -(-self.frame[1] // stride)
        return replace(self, frame=frame, lens=lens)


@dataclass(frozen=True, slots=True, eq=False)
class RenderedViews:
    """rgb (n, h, w, 3) uint8, planar depth (n, h, w) float32 metres, object id (n, h, w) int16.

    Depth is 0 where nothing was hit; object 0 is the building.
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]
    identity: NDArray[np.int16]


class SceneRenderer(Protocol):
    """Interface of renderers. Poses are (n, 3): x, y in metres, heading in radians.

    Colour is the mean of samples x samples rays per pixel. With 0 samples the image stays black
    and only depth and ids are computed.
    """

    def render(
        self, poses: NDArray[np.float64], camera: Camera, samples: int = SAMPLES
    ) -> RenderedViews: ...

    def plan(self, pixels: int) -> NDArray[np.uint8]:
        """The scene from above, (pixels, pixels, 3) uint8 RGB."""


class RayCaster:
    """Renderer with a numba kernel; the same scene and pose give the same bytes."""

    def __init__(self, scene: WorldScene) -> None:
        self._scene = scene

    @cached_property
    def _parts(self) -> tuple[Any, ...]:
        scene = pack_scene(self._scene)
        return scene.numbers, scene.codes, scene.start, scene.members, scene.cell, scene.cells

    @cached_property
    def _light(self) -> NDArray[np.float64]:
        """Light per cell, (rows, cols, 4); the last channel is the openness of the floor."""
        scene = self._scene
        cells = round(scene.size / LIGHT_CELL)
        walls = tuple(p for p in scene.building if p.high > 2.5 and p.low < 0.5)
        light = self._lamp_light(walls, cells) + np.array(scene.ambient)
        parts = [part for _, parts in scene.objects for part in parts]
        low = [part for part in (*scene.building, *parts) if part.low < 0.3]
        distance = ndimage.distance_transform_edt(
            ~footprint(low, cells, LIGHT_CELL, 0.04)
        ) * LIGHT_CELL  # fmt: skip
        openness = 1.0 - np.exp(-(distance + 0.02) / 0.22)
        return np.ascontiguousarray(np.concatenate([light, openness[..., None]], axis=2))

    def _lamp_light(self, walls: tuple[ScenePart, ...], cells: int) -> NDArray[np.float64]:
        """Light of all lamps per cell, (cells, cells, 3); it is linear in the power of each."""
        scene = self._scene
        if scene.lamp_power == scene.window_power == 1:
            return _lamp_light(scene.lamps, walls, cells)
        lamps, windows = (
            _lamp_light(tuple(lamp for lamp in scene.lamps if lamp.window == kind), walls, cells)
            for kind in (False, True)
        )
        return scene.lamp_power * lamps + scene.window_power * windows

    def render(
        self, poses: NDArray[np.float64], camera: Camera, samples: int = SAMPLES
    ) -> RenderedViews:
        shape = (len(poses), *camera.frame)
        views = RenderedViews(
            np.empty((*shape, 3), np.uint8), np.empty(shape, np.float32), np.empty(shape, np.int16)
        )
        lens = np.array(
            [camera.lens.fx, camera.lens.fy, camera.lens.cx, camera.lens.cy, camera.lens.pitch,
             camera.height, camera.forward_offset]
        )  # fmt: skip
        arguments = (
            np.ascontiguousarray(poses, dtype=np.float64), lens, samples, self._scene.ceiling,
            self._parts, self._surfaces, views.rgb, views.depth, views.identity,
        )  # fmt: skip
        with _KERNEL_LOCK:
            raycaster.render(*arguments)
        return views

    def plan(self, pixels: int) -> NDArray[np.uint8]:
        """The scene from above without its ceiling, (pixels, pixels, 3) uint8, walls dark."""
        scene = self._scene
        rgb = np.empty((pixels, pixels, 3), np.uint8)
        arguments = pixels, scene.size, _PLAN_HEIGHT, self._parts, self._surfaces, rgb
        with _KERNEL_LOCK:
            raycaster.render_plan(*arguments)
        tall = [part for part in scene.building if part.low < 0.5]
        rgb[footprint(tall, pixels, scene.size / pixels, 0.5)] = (52, 54, 58)
        return rgb

    @cached_property
    def _surfaces(self) -> tuple[Any, ...]:
        palette = np.array([(m, *colour, seed) for m, colour, seed in self._scene.palette])
        return self._scene.floor, palette, self._light, LIGHT_CELL


@lru_cache(maxsize=8)
def _lamp_light(
    lamps: tuple[Lamp, ...], walls: tuple[ScenePart, ...], cells: int
) -> NDArray[np.float64]:
    """Light of all lamps per cell, (cells, cells, 3), regardless of furniture."""
    taken = footprint(list(walls), cells, LIGHT_CELL, 2.5)
    rows = np.array(
        [(lamp.x, lamp.y, max(lamp.height, 0.8), *lamp.power) for lamp in lamps]
    ).reshape(-1, 6)
    return _soften_shadows(raycaster.light_map(rows, taken, LIGHT_CELL), taken)


def _soften_shadows(light: NDArray[np.float64], walls: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Blur shadows inside rooms without leaking light through walls."""
    open_ = ~walls
    weight = ndimage.gaussian_filter(open_.astype(float), 2.5, truncate=2)
    soft = np.stack(
        [ndimage.gaussian_filter(light[..., c] * open_, 2.5, truncate=2) for c in range(3)], axis=2
    ) / np.maximum(weight, 1e-6)[..., None]  # fmt: skip
    return np.where(open_[..., None], soft, light)
