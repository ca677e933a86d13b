"""A fisheye camera above a flat road: pixels to ground points and back.

Robot frame: x forward and y left in metres on the road, z up; the camera is above the origin.
Camera frame: x right, y down, z along the optical axis. A ray at the angle theta from the axis
meets the image at the distance f (theta + k1 theta^3 + k2 theta^5 + k3 theta^7 + k4 theta^9) from
the principal point. Source: Kannala and Brandt, "A generic camera model and calibration method for
conventional, wide-angle, and fish-eye lenses", 2006, as in OpenCV's `fisheye` module.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FisheyeCamera:
    """Intrinsics in pixels and the mount: `height` in metres above the road, `pitch` in radians
    downwards. The centre of the top left pixel is (0, 0).

    The defaults are those of a small road robot, and an image of the lower 320 rows of 640 x 480.
    """

    width: int = 640
    rows: int = 320
    focal: float = 305.0
    cx: float = 319.5
    cy: float = 79.5
    distortion: tuple[float, float, float, float] = (-0.02, 0.0, 0.0, 0.0)
    height: float = 0.108
    pitch: float = 0.32

    def scaled(self, factor: float) -> FisheyeCamera:
        """The camera whose images have `factor` times as many rows and columns."""
        return replace(
            self, width=round(self.width * factor), rows=round(self.rows * factor),
            focal=self.focal * factor, cx=(self.cx + 0.5) * factor - 0.5,
            cy=(self.cy + 0.5) * factor - 0.5,
        )  # fmt: skip

    def rays(self) -> Floats:
        """Directions (rows, width, 3) of the pixels in the robot frame, not normalised."""
        x, y = np.meshgrid(np.arange(self.width), np.arange(self.rows))
        return self.pixel_rays(np.stack([x, y], axis=-1).reshape(-1, 2)).reshape(
            self.rows, self.width, 3
        )

    def pixel_rays(self, pixels: Floats | NDArray[np.generic]) -> Floats:
        """Directions (n, 3) of pixels (n, 2) as x, y in the robot frame."""
        offset = (np.asarray(pixels, dtype=np.float64) - [self.cx, self.cy]) / self.focal
        radius = np.linalg.norm(offset, axis=1)
        angles = np.linspace(0, np.pi / 2, 2048)
        theta = np.interp(radius, self._radii(angles), angles)
        scale = np.where(radius > 1e-9, np.sin(theta) / np.maximum(radius, 1e-9), 1.0)
        right, down = (offset * scale[:, None]).T
        forward = np.cos(theta)
        sine, cosine = np.sin(self.pitch), np.cos(self.pitch)
        return np.stack(
            [forward * cosine - down * sine, -right, -forward * sine - down * cosine], axis=1
        )

    def to_ground(self, pixels: Floats | NDArray[np.generic]) -> Floats:
        """Points (n, 2) on the road in the robot frame; NaN for pixels above the horizon."""
        rays = self.pixel_rays(pixels)
        with np.errstate(divide="ignore", invalid="ignore"):
            points = rays[:, :2] * (self.height / -rays[:, 2:])
        points[rays[:, 2] >= -1e-6] = np.nan
        return np.asarray(points)

    def to_pixels(self, points: Floats) -> Floats:
        """Pixels (n, 2) of points (n, 2) on the road, also outside the image; NaN for points at or
        behind the plane of the camera."""
        x, y = np.asarray(points, dtype=np.float64).T
        sine, cosine = np.sin(self.pitch), np.cos(self.pitch)
        camera = np.stack(
            [-y, self.height * cosine - x * sine, x * cosine + self.height * sine], axis=1
        )
        camera[camera[:, 2] <= 1e-6] = np.nan
        matrix = np.array([[self.focal, 0, self.cx], [0, self.focal, self.cy], [0, 0, 1.0]])
        found = np.full((len(camera), 2), np.nan)
        seen = np.isfinite(camera).all(axis=1)
        if seen.any():
            projected, _ = cv2.fisheye.projectPoints(
                camera[seen][:, None], np.zeros(3), np.zeros(3), matrix, np.array(self.distortion)
            )
            found[seen] = projected.reshape(-1, 2)
        return found

    def _radii(self, theta: Floats) -> Floats:
        """Distances from the principal point in units of the focal length, not decreasing."""
        powers = theta[:, None] ** np.array([3, 5, 7, 9])
        return np.maximum.accumulate(theta + powers @ np.array(self.distortion))
