"""Recordings: images of one camera with 6-DoF poses, as a layout's reader finds them.

A recording is one side of a data set. `s2r ingest pairs` pairs the images of two recordings.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.common.input_issue import InputIssue


@dataclass(frozen=True, slots=True)
class PinholeCamera:
    """Intrinsics in pixels of the original images, pixel i covers [i, i + 1).

    Layouts that place the centre of pixel i at i (OpenCV, COLMAP: see each reader) are converted by
    adding 0.5 to cx and cy. `distortion` holds OpenCV's coefficients in its order, of
    `cv2.undistort`, or of `cv2.fisheye` where `is_fisheye`; empty for images without distortion.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    is_fisheye: bool = False

    @property
    def is_pinhole(self) -> bool:
        """Whether images need no undistortion; those of a fisheye lens always do."""
        return not self.is_fisheye and not any(self.distortion)

    @property
    def coefficients(self) -> NDArray[np.float64]:
        """OpenCV's coefficients (K,), of a fisheye camera always 4."""
        empty = (0.0, 0.0, 0.0, 0.0) if self.is_fisheye else ()
        return np.array(self.distortion or empty, dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class SourceImage:
    """A decoded image: RGB (H, W, 3) uint8, or depth (H, W) in raw units.

    `sha256` is that of the encoded image, `bits` those per sample in the file.
    """

    pixels: NDArray[Any]
    sha256: str
    bits: int


class RecordedImage(Protocol):
    """An image of a recording that has not been decoded.

    An interrupted ingest is resumed if all its images have an attribute `files`: the paths that
    they are read from.
    """

    @property
    def name(self) -> str:
        """The file's path relative to the recording, or `FILE:TOPIC:NANOSECONDS` in a bag."""

    @property
    def pixels(self) -> int:
        """Pixels that its header declares; 0 if it is unreadable."""

    def checksum(self) -> str | None:
        """`SourceImage.sha256` without decoding; None if it is unreadable."""

    def read(self) -> SourceImage | InputIssue:
        """The pixels, or an InputIssue that names the unusable image."""


@dataclass(frozen=True, slots=True)
class RecordedFrame:
    """The images of one instant; `depth` is None in a recording without depth."""

    rgb: RecordedImage
    depth: RecordedImage | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RecordedTrajectory:
    """Frames in recording order with their poses and times.

    `poses` (N, 4, 4) float64 are those of the camera in the recording's world, metres: a point in
    the camera's axes (x right, y down, z forward) times the matrix is that point in the world.
    Rotations are orthonormal with determinant 1. `timestamps` (N,) float64 are seconds, NaN where
    unknown.
    """

    frames: Sequence[RecordedFrame]
    poses: NDArray[np.float64]
    timestamps: NDArray[np.float64]


@dataclass(slots=True)
class Recording:
    """All trajectories of one side, by name.

    `depth_scale` is metres per raw unit of depth, or with `depth_in_world_units` units of the world
    per raw unit. `depth_raw_max` is the largest valid value, 0 is always invalid. `up` is the
    direction against gravity in the world's axes where the layout defines it. `is_metric` is False
    where the layout leaves the scale of the world open; `scale_option` then names the option of the
    layout that states it, if there is one. `has_own_worlds` is True where each trajectory has a
    world of its own, as in odometry, so that poses of different trajectories cannot be compared.
    `issues`
    report images and poses that were left out, `provenance` states options and facts of the reader.
    `outside_folders` counts the files that were read outside of the recording, by folder.
    """

    layout: str
    name: str
    root: Path
    camera: PinholeCamera
    depth_camera: PinholeCamera | None = None
    depth_scale: float = 0.001
    depth_in_world_units: bool = False
    depth_raw_max: int = 65534
    up: tuple[float, float, float] | None = None
    is_metric: bool = True
    scale_option: str | None = None
    has_own_worlds: bool = False
    trajectories: dict[str, RecordedTrajectory] = field(default_factory=dict)
    issues: list[InputIssue] = field(default_factory=list)
    provenance: dict[str, Any] = field(default_factory=dict)
    outside_folders: dict[str, int] = field(default_factory=dict)

    @property
    def has_one_world(self) -> bool:
        """Whether the poses of all trajectories can be compared."""
        return len(self.trajectories) <= 1 or not self.has_own_worlds

    def metres_of_depth(self, metres_per_unit: float) -> float:
        """Metres per raw unit of depth where a unit of the world is `metres_per_unit` long."""
        return self.depth_scale * (metres_per_unit if self.depth_in_world_units else 1.0)


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """Options of a reader.

    `values` are those of the layout by name, as text. `trajectories` are the requested ones, all by
    default. `allow_outside` admits files outside of the recording's folder.
    """

    values: Mapping[str, str] = field(default_factory=dict)
    trajectories: tuple[str, ...] = ()
    allow_outside: bool = False

    def positive(self, name: str, default: float) -> float:
        """The number that an option states. Raises RequestError unless it is larger than 0."""
        text = self.values.get(name)
        if text is None:
            return default
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0 < value < math.inf:
            raise RequestError(f"option {name}={text}: must be a number larger than 0")
        return value


ReadRecording = Callable[[Path, ReadOptions], Recording]


@dataclass(frozen=True, slots=True)
class Layout:
    """A layout of recordings: its reader, what it is, and the options that it takes.

    `options` maps the name of each option to its description.
    """

    read: ReadRecording
    description: str
    options: Mapping[str, str] = field(default_factory=dict)
