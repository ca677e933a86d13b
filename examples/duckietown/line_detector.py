"""A detector of lane lines by colour thresholds, with the interface of Duckietown's line detector.

An image is reduced to 160 x 80 pixels of road, each colour is a mask of HSV ranges, and segments
are straight pieces of the image's edges inside a mask. Numbers of HSV are those of OpenCV: hue
0 .. 180 in steps of two degrees, saturation and value 0 .. 255.

Source of the processing steps: the interface of Duckietown's `line_detector` and `anti_instagram`
packages, see `duckietown.org`; edges: Canny, "A computational approach to edge detection", 1986;
segments: Matas et al., "Robust detection of lines using the progressive probabilistic Hough
transform", 2000.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.translation.image_set import Rgb, resize

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Crop = Literal["auto", "none", "top"]

COLOURS = ("white", "yellow", "red")
"""Colours of lines; colour i has the value i + 1 in a mask."""
DETECTOR_SIZE = (80, 160)
"""Rows and columns of the image in which lines are searched."""
CROPS: tuple[str, ...] = get_args(Crop)
_TOP_SHARE = 1 / 3
"""Share of the rows that are cut off the top of a whole camera image, 40 of 120."""
_CANNY = (80, 200)
_HOUGH = {"threshold": 2, "minLineLength": 3, "maxLineGap": 1}
_NORMAL_REACH = 3.0
"""Pixels to either side of a segment at which its mask is read for the normal."""
_KERNEL = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))

Bounds = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class HsvRange:
    """Colours between two corners (hue, saturation, value), both included.

    A range whose lower hue is above its upper one continues over hue 180 at hue 0.
    """

    low: Bounds
    high: Bounds

    def boxes(self) -> list[tuple[Bounds, Bounds]]:
        """One box, or two where the range continues at hue 0."""
        if self.low[0] <= self.high[0]:
            return [(self.low, self.high)]
        return [(self.low, (180, *self.high[1:])), ((0, *self.low[1:]), self.high)]

    def contains(self, hsv: Rgb) -> Bools:
        """Which pixels (H, W, 3) lie in the range."""
        found = np.zeros(hsv.shape[:2], dtype=np.uint8)
        for low, high in self.boxes():
            found |= cv2.inRange(hsv, np.array(low), np.array(high))
        return found > 0


Thresholds = Mapping[str, HsvRange]
"""A range per colour of `COLOURS`."""

DEFAULT_THRESHOLDS: Thresholds = MappingProxyType(
    {
        "white": HsvRange((0, 0, 150), (180, 100, 255)),
        "yellow": HsvRange((25, 140, 100), (45, 255, 255)),
        "red": HsvRange((165, 140, 100), (15, 255, 255)),
    }
)


@dataclass(frozen=True, slots=True, eq=False)
class Segments:
    """Segments of one colour: `points` (n, 4) as x1, y1, x2, y2 in pixels of the detector's image,
    `normals` (n, 2) unit vectors x, y that point into the line."""

    points: NDArray[np.float32]
    normals: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """Masks (H, W) of the ranges before dilation, and segments, by colour."""

    masks: dict[str, Bools]
    segments: dict[str, Segments]


def road_part(images: NDArray[np.uint8], crop: Crop = "auto") -> NDArray[np.uint8]:
    """Rows (B, h, W, ...) of images (B, H, W, ...) that show the road.

    `top` cuts the upper third off, `none` nothing; `auto` cuts images that are less than 1.75 times
    as wide as high, such as 640 x 480, and keeps wider ones, such as 640 x 320.
    """
    if crop not in CROPS:
        raise RequestError(f"crop {crop!r}: one of {', '.join(CROPS)}")
    height, width = images.shape[1:3]
    if crop == "none" or (crop == "auto" and width >= 1.75 * height):
        return images
    return images[:, round(height * _TOP_SHARE) :]


def detector_images(rgb: Rgb, crop: Crop = "auto") -> Rgb:
    """Images (B, 80, 160, 3) for the detector of camera images (B, H, W, 3)."""
    return resize(road_part(rgb, crop), DETECTOR_SIZE)


def anti_instagram(rgb: Rgb, share: float = 0.7, percentile: float = 40.0) -> Rgb:
    """Map a percentile of each channel to 0 by a linear map that keeps 255; per image (B, H, W, 3).

    The percentile is taken over the lowest `share` of the rows, most of which are asphalt.
    """
    start = rgb.shape[1] - max(1, round(rgb.shape[1] * share))
    black = np.percentile(rgb[:, start:], percentile, axis=(1, 2)).astype(np.float32)
    black = np.minimum(black, 254)[:, None, None, :]
    return np.clip(np.rint((rgb - black) * (255 / (255 - black))), 0, 255).astype(np.uint8)


def colour_masks(rgb: Rgb, thresholds: Thresholds) -> dict[str, Bools]:
    """Masks (H, W) of an image (H, W, 3) by colour."""
    hsv = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV))
    return {colour: thresholds[colour].contains(hsv) for colour in COLOURS}


def detect(rgb: Rgb, thresholds: Thresholds) -> Detection:
    """Masks and segments of an image (H, W, 3) of the detector's size."""
    masks = colour_masks(rgb, thresholds)
    edges = cv2.Canny(np.ascontiguousarray(rgb), *_CANNY, apertureSize=3)
    segments = {colour: _segments(edges, mask) for colour, mask in masks.items()}
    return Detection(masks, segments)


def _segments(edges: NDArray[np.uint8], mask: Bools) -> Segments:
    grown = cv2.dilate(mask.astype(np.uint8), _KERNEL)
    found = cv2.HoughLinesP(edges * grown, 1, np.pi / 180, **_HOUGH)
    if found is None:
        empty = np.zeros((0, 2), dtype=np.float32)
        return Segments(np.zeros((0, 4), dtype=np.float32), empty)
    points = found.reshape(-1, 4).astype(np.float32)
    return _oriented(points, grown)


def _oriented(points: NDArray[np.float32], mask: NDArray[np.uint8]) -> Segments:
    """Segments with the normal on the side on which the mask has more pixels; the points are
    ordered so that the normal lies to the right of the direction in the image."""
    ends = points.reshape(-1, 2, 2)
    along = ends[:, 1] - ends[:, 0]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-6)
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
    side = np.zeros(len(points))
    for part in (0.25, 0.5, 0.75):
        middle = ends[:, 0] + part * (ends[:, 1] - ends[:, 0])
        for reach in (1.0, 2.0, _NORMAL_REACH):
            side += _values_at(mask, middle + reach * normals)
            side -= _values_at(mask, middle - reach * normals)
    turned = side < 0
    normals[turned] *= -1
    points = points.copy()
    points[turned] = points[turned][:, [2, 3, 0, 1]]
    return Segments(points, normals.astype(np.float32))


def _values_at(mask: NDArray[np.uint8], points: NDArray[np.floating]) -> Floats:
    """Values of a mask at the nearest pixels of points (n, 2); 0 outside."""
    height, width = mask.shape
    x, y = np.rint(points).astype(np.int64).T
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    values = np.zeros(len(points))
    values[inside] = mask[y[inside], x[inside]]
    return values
