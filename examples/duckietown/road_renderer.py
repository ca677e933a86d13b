"""Render road images with exact line masks along the lanes of a flat town.

Each pixel is the mean of `SUPERSAMPLING` squared rays to the ground. The mask is the colour that
covers more than three quarters of the pixel, `IGNORE` where none does, and where objects beside
the road are seen. Images are albedo under white light; `conditions` adds the light and the camera.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from examples.duckietown.fisheye_camera import FisheyeCamera
from examples.duckietown.road_map import TILE, RoadMap, map_pixels, road_map
from s2rtools.translation.image_set import Rgb

Floats = NDArray[np.float64]
Mask = NDArray[np.uint8]

OTHER, WHITE, YELLOW, RED, IGNORE = 0, 1, 2, 3, 255
SUPERSAMPLING = 2
_CLEAR_SHARE = 0.75
_MARGIN = 1.0
"""Metres of ground around the town."""
_FAR = 6.0
"""Metres beyond which the ground is drawn as background."""
_OBJECTS_PER_SQUARE_METRE = 6.0
_LARGEST_OBJECT = 0.12
"""Half an axis in metres."""
_FRAME_STEP = 0.08


@dataclass(frozen=True, slots=True)
class LanePose:
    """Position in the lane: `offset` in metres to the left of its middle, `heading` in radians to
    the left of its direction."""

    offset: float
    heading: float


@dataclass(frozen=True, slots=True, eq=False)
class RoadFrame:
    """A rendered image (H, W, 3), its mask (H, W) and the true pose."""

    rgb: Rgb
    mask: Mask
    pose: LanePose
    position: tuple[float, float, float]
    """x, y and heading on the map."""


@dataclass(frozen=True, slots=True, eq=False)
class Town:
    """A map with its surface: `albedo` (h, w, 3) RGB and `shares` (h, w, 4) of white, yellow, red
    and objects, both with a margin; `sky` (e, a, 3) is the background by elevation and azimuth."""

    road: RoadMap
    albedo: Rgb
    shares: NDArray[np.uint8]
    margin: int
    sky: Rgb
    colours: dict[str, tuple[int, int, int]] = field(default_factory=dict)


def build_town(seed: int, layout: int | tuple[str, ...] | None = None, lines: bool = True) -> Town:
    """A town with random surfaces and objects; without `lines` only asphalt, ground and objects."""
    rng = np.random.default_rng([seed, 17])
    road = road_map(int(rng.integers(1 << 16)) if layout is None else layout)
    height, width = road.coverage.shape[:2]
    margin = round(_MARGIN * height / (road.rows * TILE))
    shares = np.zeros((height + 2 * margin, width + 2 * margin, 4), dtype=np.uint8)
    shares[margin:-margin, margin:-margin] = road.coverage
    tile = shares[..., 3:].astype(np.float32) / 255
    asphalt = _texture(rng, shares.shape[:2], rng.uniform(48, 82), rng.uniform(4, 10), 1)
    ground = _texture(rng, shares.shape[:2], rng.uniform(55, 110), 12.0, 3)
    tint = rng.uniform(0.9, 1.1, 3)
    albedo = tile * asphalt * rng.uniform(0.97, 1.03, 3) + (1 - tile) * ground * tint
    if not lines:
        shares[..., :3] = 0
    colours = {
        "white": _jitter(rng, (236, 238, 236), 8), "yellow": _jitter(rng, (238, 200, 32), 12),
        "red": _jitter(rng, (196, 34, 42), 12),
    }  # fmt: skip
    for index, colour in enumerate(colours.values()):
        share = shares[..., index, None].astype(np.float32) / 255
        worn = 1 - 0.05 * np.abs(rng.standard_normal(shares.shape[:2]))[..., None]
        albedo = albedo * (1 - share) + share * np.array(colour) * worn
    objects = _draw_objects(rng, albedo, shares)
    shares[..., 3] = objects
    rgb = np.clip(np.rint(albedo), 0, 255).astype(np.uint8)
    return Town(road, rgb, shares, margin, _background(rng), colours)


class RoadRenderer:
    """Renders views of a town with a camera; the ground points of the pixels are computed once."""

    def __init__(self, town: Town, camera: FisheyeCamera = FisheyeCamera()) -> None:  # noqa: B008
        self.town, self.camera = town, camera
        fine = camera.scaled(SUPERSAMPLING)
        rays = fine.rays()
        down = np.minimum(rays[..., 2], -1e-6)
        ground = rays[..., :2] * (camera.height / -down)[..., None]
        self._is_ground = (rays[..., 2] < -1e-6) & (np.hypot(*ground.transpose(2, 0, 1)) < _FAR)
        self._ground = np.where(self._is_ground[..., None], ground, 0.0).astype(np.float32)
        first = np.flatnonzero(~self._is_ground.all(axis=1))
        self._sky_rows = int(first[-1]) + 1 if first.size else 0
        above = rays[: self._sky_rows]
        self._azimuth = np.arctan2(above[..., 1], above[..., 0]).astype(np.float32)
        elevation = np.arctan2(above[..., 2], np.hypot(above[..., 0], above[..., 1]))
        self._elevation = ((elevation + 0.2) / 0.9 * len(town.sky)).astype(np.float32)

    def render(self, x: float, y: float, heading: float) -> tuple[Rgb, Mask]:
        """Image and mask from a position on the map, in metres and radians."""
        town = self.town
        turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
        scale = float(map_pixels(np.ones((1, 2)))[0, 0] + 0.5)
        start = map_pixels(np.array([[x, y]]))[0] + town.margin
        at = self._ground @ (turn * scale).astype(np.float32) + start
        rgb = cv2.remap(town.albedo, at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
        shares = cv2.remap(town.shares, at, None, cv2.INTER_LINEAR, borderValue=(0, 0, 0, 0))
        if self._sky_rows:
            self._draw_background(rgb, shares, heading)
        size = (self.camera.width, self.camera.rows)
        rgb = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
        return rgb, _to_mask(cv2.resize(shares, size, interpolation=cv2.INTER_AREA))

    def _draw_background(self, rgb: Rgb, shares: NDArray[np.uint8], heading: float) -> None:
        rows = slice(0, self._sky_rows)
        sky = self.town.sky
        column = (self._azimuth + heading) / (2 * np.pi) * sky.shape[1] % sky.shape[1]
        seen = cv2.remap(
            sky, column.astype(np.float32), self._elevation, cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        hidden = ~self._is_ground[rows]
        rgb[rows][hidden] = seen[hidden]
        shares[rows][hidden] = (0, 0, 0, 255)


def _to_mask(shares: NDArray[np.uint8]) -> Mask:
    lines = shares[..., :3]
    best = lines.argmax(axis=2)
    covered = np.take_along_axis(lines, best[..., None], axis=2)[..., 0]
    mask = np.where(covered > 255 * _CLEAR_SHARE, best + 1, IGNORE).astype(np.uint8)
    mask[lines.astype(np.int32).sum(axis=2) < 255 * (1 - _CLEAR_SHARE)] = OTHER
    mask[shares[..., 3] > 255 * (1 - _CLEAR_SHARE)] = IGNORE
    return mask


def drive(
    town: Town,
    frames: int,
    seed: int,
    camera: FisheyeCamera = FisheyeCamera(),  # noqa: B008
) -> Iterator[RoadFrame]:
    """Frames along a lane, about 8 cm apart, with a wandering offset and heading."""
    rng = np.random.default_rng([seed, 29])
    path = town.road.path(rng, frames * _FRAME_STEP + 0.2)
    renderer = RoadRenderer(town, camera)
    offset, lean = rng.normal(0, 0.03), rng.normal(0, 0.1)
    for frame in range(frames):
        at = path[min(len(path) - 1, round(frame * _FRAME_STEP / 0.01))]
        offset = float(np.clip(0.85 * offset + rng.normal(0, 0.018), -0.09, 0.09))
        lean = float(np.clip(0.8 * lean + rng.normal(0, 0.08), -0.5, 0.5))
        x = at[0] - offset * np.sin(at[2])
        y = at[1] + offset * np.cos(at[2])
        rgb, mask = renderer.render(x, y, at[2] + lean)
        yield RoadFrame(rgb, mask, LanePose(offset, lean), (x, y, float(at[2] + lean)))


def _jitter(
    rng: np.random.Generator, colour: tuple[int, int, int], spread: float
) -> tuple[int, int, int]:
    values = np.clip(np.rint(np.array(colour) + rng.normal(0, spread, 3)), 0, 255)
    return int(values[0]), int(values[1]), int(values[2])


def _texture(
    rng: np.random.Generator, size: tuple[int, int], mean: float, spread: float, channels: int
) -> NDArray[np.float32]:
    """Grey levels (h, w, channels) of patches in three sizes."""
    total = np.zeros((*size, channels), dtype=np.float32)
    for grain, weight in ((1, 0.7), (6, 0.5), (60, 0.8)):
        small = (max(2, size[0] // grain), max(2, size[1] // grain))
        noise = rng.standard_normal((*small, channels), dtype=np.float32)
        scaled = cv2.resize(noise, size[::-1], interpolation=cv2.INTER_LINEAR)
        total += weight * scaled.reshape(*size, channels)
    return mean + spread * total


def _draw_objects(
    rng: np.random.Generator, albedo: NDArray[np.floating], shares: NDArray[np.uint8]
) -> Mask:
    """Coloured flat objects on the ground beside the road; returns their share (h, w)."""
    objects = np.zeros(shares.shape[:2], dtype=np.uint8)
    height, width = shares.shape[:2]
    metre = float(map_pixels(np.ones((1, 2)))[0, 0])
    reach = int(_LARGEST_OBJECT * metre) + 1
    for _ in range(int(_OBJECTS_PER_SQUARE_METRE * height * width / metre**2)):
        y, x = int(rng.integers(reach, height - reach)), int(rng.integers(reach, width - reach))
        axes = rng.uniform(0.02, _LARGEST_OBJECT, 2) * metre
        shape = np.zeros((2 * reach, 2 * reach), dtype=np.uint8)
        angle = float(rng.uniform(0, 180))
        cv2.ellipse(shape, (reach, reach), (int(axes[0]), int(axes[1])), angle, 0, 360, 255, -1)
        colour = rng.uniform(10, 245, 3)
        window = np.s_[y - reach : y + reach, x - reach : x + reach]
        if not shares[window][..., 3][shape > 0].any():
            albedo[window][shape > 0] = colour
            objects[window] |= shape
    return objects


def _background(rng: np.random.Generator) -> Rgb:
    """A wall with coloured rectangles, 96 rows of elevation and 1024 columns of azimuth."""
    sky = np.empty((96, 1024, 3), dtype=np.float32)
    sky[:] = rng.uniform(70, 190) * rng.uniform(0.85, 1.15, 3)
    for _ in range(60):
        x, y = int(rng.integers(1024)), int(rng.integers(96))
        w, h = int(rng.integers(8, 90)), int(rng.integers(6, 50))
        sky[y : y + h, x : x + w] = rng.uniform(20, 220, 3)
    return np.clip(cv2.GaussianBlur(sky, (0, 0), 1.5), 0, 255).astype(np.uint8)
