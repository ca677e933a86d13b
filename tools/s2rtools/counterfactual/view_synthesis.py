"""Synthesise what the camera of one rig would see of an image that the other rig recorded.

The depth of the new view is found by splatting the recorded depth with a z-buffer; the image is
then sampled backwards, so that its colours are interpolated once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.camera import into_rgb, rays
from s2rstore.records import Domain, Intrinsics
from s2rtools.common.numba_cache import njit

SPLATS = 3
"""Points along each side of a recorded pixel that are splatted."""
STEEP = 0.04
"""Relative depth difference of neighbours from which depth is not interpolated between them."""

Frame = tuple[int, int]


@dataclass(frozen=True, slots=True, eq=False)
class SynthesisedView:
    """The other rig's image in the RGB camera of this rig.

    `rgb` (h, w, 3) float32 levels 0 .. 255; `depth` (h, w) float32 planar depth in metres, 0 where
    it is unknown; `seen` (h, w) where the pixel lies in the other rig's image.
    """

    rgb: NDArray[np.float32]
    depth: NDArray[np.float32]
    seen: NDArray[np.bool_]


class ViewSynthesis:
    """Synthesises views of the rig `target` from images of the rig `source` at the same pose.

    `frame` (height, width) is the size of the images of both.
    """

    def __init__(self, source: Domain, target: Domain, frame: Frame) -> None:
        self._source, self._target, self._frame = source, target, frame
        height, width = frame
        fine_rows, fine_cols = (
            (np.arange(extent * SPLATS) + 0.5) / SPLATS for extent in (height, width)
        )
        rows, cols = np.arange(height) + 0.5, np.arange(width) + 0.5
        self._splat_rays = _directions(source.rgb, fine_rows, fine_cols)
        self._rays = _directions(target.rgb, rows, cols)
        self._rise = np.float32(source.camera_height - target.camera_height)
        self._ahead = np.float32(source.forward_offset - target.forward_offset)

    def __call__(self, rgb: NDArray[Any], metres: NDArray[np.float32]) -> SynthesisedView:
        """The view of an image: rgb (h, w, 3) and planar depth (h, w) in metres, 0 if unknown.

        Both belong to the pixels of the source's RGB camera. Surfaces that are hidden in the image
        count as not seen.
        """
        surface = self.surface(metres)
        view = self.sampled(rgb, metres, surface)
        nearest = cv2.erode(surface, np.ones((3, 3), np.uint8))  # edges may be a pixel off
        is_hidden = (view.depth > 0) & (view.depth < nearest * np.float32(1 - STEEP))
        return replace(view, seen=view.seen & ~is_hidden)

    def surface(self, metres: NDArray[np.float32]) -> NDArray[np.float32]:
        """Planar depth (h, w) in the target's RGB camera of the source's depth."""
        height, width = self._frame
        size = width * SPLATS, height * SPLATS
        fine = cv2.resize(metres, size, interpolation=cv2.INTER_NEAREST)
        u, v, depth = _project(self._splat_rays, fine, self._target.rgb, self._rise, self._ahead)
        nearest = _splat(u, v, np.where(fine > 0, depth, np.float32(0)), height, width)
        return np.asarray(cv2.medianBlur(_fill_holes(nearest), 3))

    def sampled(
        self, rgb: NDArray[Any], metres: NDArray[np.float32], surface: NDArray[np.float32]
    ) -> SynthesisedView:
        """The view of an image where the target sees the depth `surface` (h, w), 0 if unknown."""
        x, y, expected, seen = self._positions(surface)
        colours = cv2.remap(
            rgb.astype(np.float32), x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
        found = _sample_depth(metres, x, y)
        with np.errstate(invalid="ignore", divide="ignore"):
            depth = np.where(seen & (found > 0), surface * found / expected, np.float32(0))
        return SynthesisedView(np.clip(colours, 0, 255), depth, seen)

    def warped(
        self, values: NDArray[np.float32], surface: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Values (n, h, w) over the source's image in the target's view, 0 where it is not seen."""
        x, y, _, seen = self._positions(surface)
        planes = [cv2.remap(each, x, y, cv2.INTER_LINEAR, borderValue=0) for each in values]
        return np.where(seen, np.stack(planes), np.float32(0))

    def _positions(
        self, surface: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]:
        """Source pixel (column, row) and depth there of each target pixel, and where it is seen."""
        height, width = self._frame
        u, v, expected = _project(self._rays, surface, self._source.rgb, -self._rise, -self._ahead)
        known = (surface > 0) & (expected > 0)
        seen = known & (u >= 0) & (u < width) & (v >= 0) & (v < height)
        x, y = (np.where(known, value - np.float32(0.5), np.float32(-9)) for value in (u, v))
        return x, y, expected, seen


class DepthInRgbView:
    """Registers depth images of a rig to the pixels of its RGB camera and back.

    Both cameras are taken to share their centre, as in `into_rgb`.
    """

    def __init__(self, rig: Domain, frame: Frame) -> None:
        self._scale = np.float32(rig.depth_scale)
        self.is_identity = rig.rgb == rig.depth
        rows, cols = (np.arange(extent, dtype=np.float64) + 0.5 for extent in frame)
        directions = rays(rig.rgb, rows, cols)
        u, v, self._inside = into_rgb(directions, rig.depth, frame)
        self._x, self._y = (value.astype(np.float32) - np.float32(0.5) for value in (u, v))
        cos, sin = np.cos(rig.depth.pitch), np.sin(rig.depth.pitch)
        axis = np.maximum(cos * directions.forward + sin * directions.up, 1e-6)
        self._axis = axis.astype(np.float32)
        u, v, self._covered = into_rgb(rays(rig.depth, rows, cols), rig.rgb, frame)
        self._back_x, self._back_y = (
            value.astype(np.float32) - np.float32(0.5) for value in (u, v)
        )

    def metres(self, depth: NDArray[Any], valid: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Planar depth (h, w) of the RGB pixels in metres, 0 where unknown, of raw depth."""
        known = np.where(valid, depth * self._scale, np.float32(0)).astype(np.float32)
        if self.is_identity:
            return known
        picked = cv2.remap(known, self._x, self._y, cv2.INTER_NEAREST, borderValue=0)
        return np.where(self._inside, picked / self._axis, np.float32(0))

    def to_depth_pixels(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Values (h, w) of RGB pixels at the pixels of the depth camera, 0 beyond the RGB view."""
        if self.is_identity:
            return values
        picked = cv2.remap(values, self._back_x, self._back_y, cv2.INTER_NEAREST, borderValue=0)
        return np.where(self._covered, picked, np.float32(0))

    def moved_to_rgb(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Values (n, rows, cols) over the depth image added up in the pixels of the RGB image.

        Both grids have the same number of cells, of any size; sums stay but for values beyond the
        RGB view.
        """
        if self.is_identity:
            return values
        rows, cols = values.shape[1:]
        height, width = self._back_x.shape
        centres = [
            ((np.arange(count) + 0.5) * extent / count).astype(np.intp)
            for count, extent in ((rows, height), (cols, width))
        ]
        at = np.ix_(*centres)
        row = np.clip((self._back_y[at] + 0.5) * rows / height, 0, rows - 1).astype(np.intp)
        col = np.clip((self._back_x[at] + 0.5) * cols / width, 0, cols - 1).astype(np.intp)
        cell, covered = row * cols + col, self._covered[at]
        moved = [
            np.bincount(cell[covered], each[covered], rows * cols).reshape(rows, cols)
            for each in values
        ]
        return np.stack(moved).astype(np.float32)

    def to_depth_camera(
        self, metres: NDArray[np.float32], beyond: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Planar depth (h, w) of the RGB pixels as planar depth of the depth camera's pixels.

        `beyond` (h, w) is the depth of the depth camera's pixels that the RGB view does not cover.
        """
        if self.is_identity:
            return metres
        picked = self.to_depth_pixels(metres * self._axis)
        return np.where(self._covered, picked, beyond)


def _directions(lens: Intrinsics, rows: NDArray[Any], cols: NDArray[Any]) -> NDArray[np.float32]:
    """Rays (3, rows, cols): metres to the right, up and forward per metre of planar depth."""
    found = rays(lens, rows, cols)
    return np.stack([found.right, found.up, found.forward]).astype(np.float32)


def _project(
    directions: NDArray[np.float32],
    metres: NDArray[np.float32],
    lens: Intrinsics,
    rise: np.float32,
    ahead: np.float32,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Column, row and planar depth in a camera that is `rise` metres lower, `ahead` behind."""
    right, up, forward = directions * metres
    up += rise
    forward += ahead
    cos, sin = np.float32(np.cos(lens.pitch)), np.float32(np.sin(lens.pitch))
    depth = cos * forward + sin * up
    with np.errstate(invalid="ignore", divide="ignore"):
        u = np.float32(lens.cx) + np.float32(lens.fx) * right / depth
        v = np.float32(lens.cy) - np.float32(lens.fy) * (cos * up - sin * forward) / depth
    return u, v, depth


@njit(cache=True)
def _splat(
    u: NDArray[np.float32], v: NDArray[np.float32], depth: NDArray[np.float32],
    height: int, width: int,
) -> NDArray[np.float32]:  # fmt: skip
    """Least depth (height, width) of the points that fall into each pixel, 0 where none does."""
    nearest = np.zeros((height, width), dtype=np.float32)
    for i in range(u.shape[0]):
        for j in range(u.shape[1]):
            metres = depth[i, j]
            if metres <= 0.05:
                continue
            x, y = u[i, j], v[i, j]
            if x < 0 or y < 0 or x >= width or y >= height:
                continue
            row, col = int(y), int(x)
            if nearest[row, col] == 0 or metres < nearest[row, col]:
                nearest[row, col] = metres
    return nearest


def _fill_holes(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Depth with each unknown pixel (0) replaced by the nearest known one."""
    unknown = depth == 0
    if unknown.all() or not unknown.any():
        return depth
    _, labels = cv2.distanceTransformWithLabels(
        unknown.astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    values = np.zeros(labels.max() + 1, dtype=np.float32)
    values[labels[~unknown]] = depth[~unknown]
    return np.asarray(values[labels], dtype=np.float32)


def _sample_depth(
    metres: NDArray[np.float32], x: NDArray[np.float32], y: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Depth at continuous pixels: linear on smooth surfaces, else that of the nearest pixel."""
    kernel = np.ones((3, 3), np.uint8)
    steep = cv2.dilate(metres, kernel) > cv2.erode(metres, kernel) * np.float32(1 + STEEP)
    nearest = cv2.remap(metres, x, y, cv2.INTER_NEAREST, borderValue=0)
    linear = cv2.remap(metres, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    at_edge = cv2.remap(steep.astype(np.uint8), x, y, cv2.INTER_NEAREST, borderValue=1) > 0
    return np.where(at_edge | (nearest == 0), nearest, linear)
