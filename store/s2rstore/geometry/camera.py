"""From depth pixels to the floor: pinhole rays of both cameras and their registration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Domain, Intrinsics

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Directions through a grid of image samples at unit planar depth, in the level robot frame.

    Each array has shape (rows, cols): metres to the right, upwards and forward of the camera per
    metre of planar depth, the camera's pitch taken out.
    """

    right: Floats
    up: Floats
    forward: Floats

    def at(self, samples: NDArray[np.intp]) -> Rays:
        """Select rays by flat indices (m,); every array of the result has shape (m,)."""
        return Rays(*(part.ravel()[samples] for part in (self.right, self.up, self.forward)))


def sample_pixels(count: int, extent: int) -> NDArray[np.intp]:
    """Indices of `count` pixels spread evenly over `extent` of them."""
    return np.asarray(np.floor((np.arange(count) + 0.5) * (extent / count)), dtype=np.intp)


def rays(camera: Intrinsics, rows: Floats, cols: Floats) -> Rays:
    """Rays through a grid of continuous image coordinates, rows (r,) by columns (c,)."""
    shape = rows.size, cols.size
    right = np.broadcast_to((cols[None, :] - camera.cx) / camera.fx, shape)
    up = np.broadcast_to(-(rows[:, None] - camera.cy) / camera.fy, shape)
    cos, sin = np.cos(camera.pitch), np.sin(camera.pitch)
    return Rays(right.copy(), sin + cos * up, cos - sin * up)


def to_floor(
    rays: Rays, metres: Floats, domain: Domain, poses: Floats, y_down: bool
) -> tuple[Floats, Floats, Floats]:
    """Map coordinates and height above the floor of depth samples.

    `metres` (n, rows, cols) is planar depth, `poses` (n, 3) are x, y in metres and heading in
    radians. Gives x, y and height, each (n, rows, cols), metres.
    """
    forward = metres * rays.forward + domain.forward_offset
    right = metres * rays.right
    cos = np.cos(poses[:, 2])[:, None, None]
    sin = np.sin(poses[:, 2])[:, None, None]
    hand = 1.0 if y_down else -1.0
    x = poses[:, 0][:, None, None] + forward * cos - hand * right * sin
    y = poses[:, 1][:, None, None] + forward * sin + hand * right * cos
    return x, y, domain.camera_height + metres * rays.up


def into_rgb(
    rays: Rays, camera: Intrinsics, frame: tuple[int, int]
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Where depth rays fall in the RGB image, taking both cameras to share their centre.

    Gives continuous column and row (rows, cols) and whether that lies inside the frame. Depth
    does not matter, because the two cameras differ in rotation and lens only.
    """
    cos, sin = np.cos(camera.pitch), np.sin(camera.pitch)
    depth = cos * rays.forward + sin * rays.up
    up = cos * rays.up - sin * rays.forward
    ahead = depth > 1e-6
    safe = np.where(ahead, depth, 1.0)
    u = camera.cx + camera.fx * rays.right / safe
    v = camera.cy - camera.fy * up / safe
    inside = ahead & (u >= 0) & (u < frame[1]) & (v >= 0) & (v < frame[0])
    return u, v, inside
