"""A robot that follows its lane in simulation, with or without a translator before the detector.

Each step renders the road from the robot's pose, adds the light of a condition, translates the
image, detects lines, estimates the pose in the lane and steers. The robot is a unicycle that drives
at constant speed: x' = v cos(h), y' = v sin(h), h' = w.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from examples.duckietown.conditions import Condition, LightField
from examples.duckietown.fisheye_camera import FisheyeCamera
from examples.duckietown.lane_pose import lane_pose
from examples.duckietown.line_detector import (
    DETECTOR_SIZE,
    Thresholds,
    detect,
    detector_images,
)
from examples.duckietown.rendered_folder import lit_frames
from examples.duckietown.road_images import reduce_mask
from examples.duckietown.road_map import LANE_OFFSET
from examples.duckietown.road_renderer import LanePose, RoadRenderer, Town, build_town
from examples.duckietown.tuning import tune
from s2rtools.translation.image_set import Rgb
from s2rtools.translation.method import Translator, blend

Floats = NDArray[np.float64]

LOOP = ("┌─┐ ", "│ └┐", "└──┘")
"""A road without intersections that turns in both directions."""
CAMERA = FisheyeCamera().scaled(0.5)
"""Half the resolution of the robot's camera; the detector reduces images further."""
_SEARCH = 40
"""Points of the path, 10 mm apart, among which the nearest one ahead is searched."""
_SLOWEST = 2.0
"""A drive ends after this many times the duration of the route."""


@dataclass(frozen=True, slots=True)
class DriveSettings:
    """`speed` in m/s, `period` in seconds, `distance` of the route in metres; `delay` in periods
    between an image and its command; gains of the steering in rad/s per metre and per radian."""

    speed: float = 0.2
    period: float = 0.1
    distance: float = 6.0
    delay: int = 0
    offset_gain: float = 16.0
    heading_gain: float = 5.0
    max_turn: float = 4.0
    patience: int = 5
    """Steps without a pose during which the last command stays; then the robot goes straight."""


@dataclass(frozen=True, slots=True)
class Drive:
    """One drive. `offsets` are metres to the left of the lane's middle; `kept` tells whether the
    robot stayed inside the lane, `progress` is the share of the route driven until it left, and
    `detected` the share of images with a pose."""

    offsets: tuple[float, ...]
    kept: bool
    progress: float
    detected: float

    @property
    def mean_error(self) -> float:
        """Mean distance from the lane's middle in metres."""
        return float(np.mean(np.abs(self.offsets)))


@dataclass(frozen=True, slots=True, eq=False)
class Perception:
    """What turns a camera image into a pose: an optional translator, and the detector."""

    camera: FisheyeCamera
    thresholds: Thresholds
    translator: Translator | None = None
    strength: float = 1.0

    def pose(self, rgb: Rgb) -> LanePose | None:
        """The pose in the lane on an image (H, W, 3), None where too few lines are found."""
        images = rgb[None]
        if self.translator is not None:
            images = blend(images, self.translator.translate(images), self.strength)
        detection = detect(detector_images(images, "none")[0], self.thresholds)
        return lane_pose(
            detection.segments, self.camera.scaled(DETECTOR_SIZE[1] / self.camera.width)
        )


def tuned_thresholds(condition: Condition, seed: int, frames: int = 40) -> Thresholds:
    """Ranges of the line detector tuned on rendered images of a condition, with their exact
    masks."""
    lit = list(lit_frames([condition], frames, seed, camera=CAMERA))
    images = np.concatenate([detector_images(frame.rgb[None], "none") for frame in lit])
    return tune(images, np.stack([reduce_mask(frame.mask) for frame in lit])).thresholds


def follow_lane(
    condition: Condition,
    seed: int,
    thresholds: Thresholds,
    translator: Translator | None = None,
    strength: float = 1.0,
    settings: DriveSettings = DriveSettings(),
) -> Drive:
    """Drive along a loop in a light until the route ends or the lane is left."""
    rng = np.random.default_rng([seed, 53])
    town, camera = _town(seed), CAMERA
    renderer = RoadRenderer(town, camera)
    light = LightField(condition, (camera.rows, camera.width), seed)
    perception = Perception(camera, thresholds, translator, strength)
    path = town.road.path(rng, settings.distance + 1.0)
    steering = _Steering(settings)
    start, at = path[0], 0
    x, y, heading = float(start[0]), float(start[1]), float(start[2] + rng.normal(0, 0.1))
    offsets: list[float] = []
    found = 0
    last = round(settings.distance / 0.01)
    longest = int(_SLOWEST * settings.distance / (settings.speed * settings.period))
    while at < last and len(offsets) < longest:
        offset, at = _offset(path, at, x, y)
        offsets.append(offset)
        if abs(offset) > LANE_OFFSET:
            break
        rgb, _ = renderer.render(x, y, heading)
        pose = perception.pose(light.apply(rgb))
        found += pose is not None
        turn = steering.command(pose)
        x += settings.speed * settings.period * float(np.cos(heading + turn * settings.period / 2))
        y += settings.speed * settings.period * float(np.sin(heading + turn * settings.period / 2))
        heading += turn * settings.period
    return Drive(tuple(offsets), at >= last, min(1.0, at / last), found / len(offsets))


@lru_cache(maxsize=4)
def _town(seed: int) -> Town:
    return build_town(seed, LOOP)


class _Steering:
    """Turn rate in rad/s from poses: proportional to offset and heading, delayed and limited."""

    def __init__(self, settings: DriveSettings) -> None:
        self._settings = settings
        self._queue: deque[float] = deque([0.0] * settings.delay)
        self._last, self._blind = 0.0, 0

    def command(self, pose: LanePose | None) -> float:
        of = self._settings
        if pose is not None:
            turn = -of.offset_gain * pose.offset - of.heading_gain * pose.heading
            self._last, self._blind = float(np.clip(turn, -of.max_turn, of.max_turn)), 0
        else:
            self._blind += 1
            if self._blind > of.patience:
                self._last = 0.0
        self._queue.append(self._last)
        return self._queue.popleft()


def _offset(path: Floats, at: int, x: float, y: float) -> tuple[float, int]:
    """Distance to the left of the path, and the index of the nearest point from `at` on."""
    ahead = path[at : at + _SEARCH]
    nearest = int(np.hypot(ahead[:, 0] - x, ahead[:, 1] - y).argmin())
    px, py, heading = ahead[nearest]
    return float((y - py) * np.cos(heading) - (x - px) * np.sin(heading)), at + nearest


@dataclass(frozen=True, slots=True)
class TranslatedDrives:
    """Drives of all seeds in one light, with or without the translator."""

    condition: str
    translated: bool
    drives: tuple[Drive, ...]

    def summary(self) -> dict[str, Any]:
        """Share of drives that kept the lane, and means over drives."""
        return {
            "condition": self.condition,
            "translated": self.translated,
            "drives": len(self.drives),
            "kept": sum(drive.kept for drive in self.drives),
            "progress": float(np.mean([drive.progress for drive in self.drives])),
            "mean_error_m": float(np.mean([drive.mean_error for drive in self.drives])),
            "detected": float(np.mean([drive.detected for drive in self.drives])),
        }


def compare(
    conditions: Sequence[Condition],
    seeds: Sequence[int],
    translator: Translator,
    thresholds: Thresholds,
    strength: float = 1.0,
    settings: DriveSettings = DriveSettings(),
    advance: Callable[[int], None] = lambda steps: None,
) -> Iterator[TranslatedDrives]:
    """Drive in each light without and with the translator; both use the same seeds."""
    for condition in conditions:
        for used in (None, translator):
            drives = []
            for seed in seeds:
                drives.append(follow_lane(condition, seed, thresholds, used, strength, settings))
                advance(1)
            yield TranslatedDrives(condition.name, used is not None, tuple(drives))
