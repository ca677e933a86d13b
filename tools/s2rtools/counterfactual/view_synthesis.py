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
_NEAREST = 0.05
"""Metres from which a point counts."""
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
        nearest = _splat(
            self._splat_rays, metres, SPLATS, _lens(self._target.rgb), self._rise, self._ahead
        )
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

    def nearest(self, values: NDArray[Any], metres: NDArray[np.float32]) -> NDArray[Any]:
        """Values (h, w) over the source's image in the target's view, those of the nearest pixel.

        `metres` (h, w) is as in `__call__`. 0 where the source does not see the pixel.
        """
        x, y, _, seen = self._positions(self.surface(metres))
        return np.where(seen, cv2.remap(values, x, y, cv2.INTER_NEAREST), 0).astype(values.dtype)

    def _positions(
        self, surface: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]:
        """Source pixel (column, row) and depth there of each target pixel, and where it is seen."""
        lens = _lens(self._source.rgb)
        x, y, expected, seen = _positions(self._rays, surface, lens, -self._rise, -self._ahead)
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


def _lens(lens: Intrinsics) -> NDArray[np.float32]:
    """fx, fy, cx, cy, cosine and sine of the pitch."""
    cos, sin = np.cos(lens.pitch), np.sin(lens.pitch)
    return np.array([lens.fx, lens.fy, lens.cx, lens.cy, cos, sin], dtype=np.float32)


@njit(cache=True, error_model="numpy")
def _positions(
    directions: NDArray[np.float32],
    metres: NDArray[np.float32],
    lens: NDArray[np.float32],
    rise: np.float32,
    ahead: np.float32,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]:
    """Where a camera `rise` metres lower and `ahead` behind sees the points at depth (h, w).

    Column and row of pixel centres, -9 for unknown depth, planar depth there, and whether the
    point lies in the image, of equal size.
    """
    fx, fy, cx, cy, cos, sin = lens
    height, width = metres.shape
    x, y = np.empty_like(metres), np.empty_like(metres)
    expected, seen = np.zeros_like(metres), np.zeros((height, width), dtype=np.bool_)
    half, nowhere = np.float32(0.5), np.float32(-9)
    for i in range(height):
        for j in range(width):
            planar = metres[i, j]
            up = directions[1, i, j] * planar + rise
            forward = directions[2, i, j] * planar + ahead
            depth = cos * forward + sin * up
            expected[i, j] = depth
            if planar <= 0 or depth <= 0:
                x[i, j], y[i, j] = nowhere, nowhere
                continue
            u = cx + fx * (directions[0, i, j] * planar) / depth
            v = cy - fy * (cos * up - sin * forward) / depth
            x[i, j], y[i, j] = u - half, v - half
            seen[i, j] = u >= 0 and u < width and v >= 0 and v < height
    return x, y, expected, seen


@njit(cache=True, error_model="numpy")
def _splat(
    directions: NDArray[np.float32],
    metres: NDArray[np.float32],
    splats: int,
    lens: NDArray[np.float32],
    rise: np.float32,
    ahead: np.float32,
) -> NDArray[np.float32]:
    """Least depth (h, w) of the points that fall into each pixel of a camera, 0 where none does.

    The points lie at depth (h, w) along directions (3, h * splats, w * splats). The camera, whose
    image has the same size, is `rise` metres lower and `ahead` behind.
    """
    fx, fy, cx, cy, cos, sin = lens
    height, width = metres.shape
    nearest = np.zeros((height, width), dtype=np.float32)
    rows, columns, nearest_depth = np.float32(height), np.float32(width), np.float32(_NEAREST)
    for i in range(height * splats):
        for pixel in range(width):
            planar = metres[i // splats, pixel]
            if planar <= 0:
                continue
            for j in range(pixel * splats, (pixel + 1) * splats):
                up = directions[1, i, j] * planar + rise
                forward = directions[2, i, j] * planar + ahead
                depth = cos * forward + sin * up
                if depth <= nearest_depth:
                    continue
                x = cx + fx * (directions[0, i, j] * planar) / depth
                y = cy - fy * (cos * up - sin * forward) / depth
                if x < 0 or y < 0 or x >= columns or y >= rows:
                    continue
                row, col = np.int32(y), np.int32(x)
                if nearest[row, col] == 0 or depth < nearest[row, col]:
                    nearest[row, col] = depth
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
