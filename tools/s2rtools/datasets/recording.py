"""Recordings: images of one camera with 6-DoF poses, which a layout's reader fills in.

A recording is one side of a data set. `s2r ingest pairs` pairs the images of two recordings. A
reader says where the numbers of its layout are; `Recording.finish` checks them.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError, counted
from s2rstore.lazy_sequence import chosen
from s2rstore.records import Intrinsics
from s2rtools.common.image_files import MAX_PIXELS
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recordings.recorded_poses import orthonormal, report_unusable
from s2rtools.datasets.scan import choose_trajectories

_LATEST = 1e12
"""Seconds; later times are unknown."""
MAX_SIDE = 16_384
"""Rows or columns of an image of a recording."""
_MAX_FOCAL = 1e6
_MAX_NAME = 80
_PARTS = re.compile(r"([0-9]+)|([^0-9]+)")


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

    def checked(self, where: str) -> PinholeCamera:
        """The camera. Raises RequestError, beginning with `where`, if it cannot exist."""
        size = f"{self.width}x{self.height}"
        if self.width < 1 or self.height < 1 or self.width * self.height > MAX_PIXELS:
            raise RequestError(f"{where}: images of {size} pixels; at most {MAX_PIXELS:,} are read")
        if max(self.width, self.height) > MAX_SIDE:
            raise RequestError(f"{where}: {size} is not a usable image size")
        for name in ("fx", "fy"):
            if not 0 < (value := getattr(self, name)) <= _MAX_FOCAL:
                limits = f"0 < {name} <= {_MAX_FOCAL:,.0f}"
                raise RequestError(f"{where}: {name} is {value:g}; expected {limits}")
        for name in ("cx", "cy"):
            if not abs(value := getattr(self, name)) <= _MAX_FOCAL:
                raise RequestError(f"{where}: {name} is {value:g}")
        if not all(math.isfinite(value) for value in self.distortion):
            raise RequestError(f"{where}: the distortion is not finite")
        lengths = (0, 4) if self.is_fisheye else (0, 4, 5, 8, 12, 14)
        if len(self.distortion) not in lengths:
            count = f"{len(self.distortion)} coefficients of distortion"
            raise RequestError(f"{where}: {count}; OpenCV has {', '.join(map(str, lengths))}")
        return self

    def resized(self, size: tuple[int, int]) -> PinholeCamera:
        """The camera for images that were resized to (height, width).

        Distortion does not depend on the size.
        """
        columns, rows = size[1] / self.width, size[0] / self.height
        return replace(
            self,
            width=size[1],
            height=size[0],
            fx=self.fx * columns,
            fy=self.fy * rows,
            cx=self.cx * columns,
            cy=self.cy * rows,
        )

    def intrinsics(self, frame: tuple[int, int], pitch: float) -> Intrinsics:
        """The intrinsics for frames of (height, width); `pitch` in radians."""
        camera = self.resized(frame)
        return Intrinsics(camera.fx, camera.fy, camera.cx, camera.cy, pitch)

    @property
    def coefficients(self) -> NDArray[np.float64]:
        """OpenCV's coefficients (K,), of a fisheye camera always 4."""
        empty = (0.0, 0.0, 0.0, 0.0) if self.is_fisheye else ()
        return np.array(self.distortion or empty, dtype=np.float64)


UNKNOWN_CAMERA = PinholeCamera(0, 0, math.nan, math.nan, math.nan, math.nan)


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
    they are read from. Depth images of several types are told apart before they are decoded by an
    attribute `declared_type`, that of numpy.
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
    A reader may give poses that are not usable, and says with `place` where that of a row stands,
    by default by the name of its image; in a finished recording rotations are orthonormal with
    determinant 1. `timestamps` (N,) float64 are seconds, NaN where unknown.
    """

    frames: Sequence[RecordedFrame]
    poses: NDArray[np.float64]
    timestamps: NDArray[np.float64]
    place: Callable[[int], str] | None = None


@dataclass(slots=True)
class Recording:
    """All trajectories of one side, by name, from files in the folder `root`.

    `depth_scale` is metres per raw unit of depth, or with `depth_in_world_units` units of the world
    per raw unit. `depth_raw_max` is the largest valid value, 0 is always invalid. `up` is the
    direction against gravity in the world's axes where the layout defines it. `is_metric` is False
    where the layout leaves the scale of the world open; `scale_option` then names the option of the
    layout that states it, if there is one. `has_own_worlds` is True where each trajectory has a
    world of its own, as in odometry, so that poses of different trajectories cannot be compared.
    `issues` report images and poses that were left out, `provenance` states options and facts of
    the reader. `allow_outside` admits files outside of `root`; `outside_folders` counts those that
    were read, by folder.
    """

    layout: str
    name: str
    root: Path
    camera: PinholeCamera = UNKNOWN_CAMERA
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
    allow_outside: bool = False
    containment: PathContainment = field(init=False)

    def __post_init__(self) -> None:
        self.containment = PathContainment(self.root, self.allow_outside)

    @classmethod
    def of_folder(cls, layout: str, folder: Path, options: ReadOptions) -> Recording:
        """An empty recording of a folder. Raises RequestError if there is no such folder."""
        existing_folder(folder)
        name = folder_name(folder)
        return cls(layout, name, folder, allow_outside=options.allow_outside)

    @property
    def has_one_world(self) -> bool:
        """Whether the poses of all trajectories can be compared."""
        return len(self.trajectories) <= 1 or not self.has_own_worlds

    @property
    def camera_of_depth(self) -> PinholeCamera:
        return self.depth_camera or self.camera

    @property
    def outside_folders(self) -> dict[str, int]:
        return self.containment.outside_folders

    @property
    def only_name(self) -> str:
        """The name of the trajectory of a layout that has one."""
        return trajectory_name(self.name)

    def metres_of_depth(self, metres_per_unit: float) -> float:
        """Metres per raw unit of depth where a unit of the world is `metres_per_unit` long."""
        return self.depth_scale * (metres_per_unit if self.depth_in_world_units else 1.0)

    def state_scale(self, options: ReadOptions) -> float:
        """Metres per unit of the world by the option `scale`; 1 where the scale is not known."""
        self.is_metric, self.scale_option = "scale" in options.values, "scale"
        return options.positive("scale", 1.0)

    def resolve(self, name: str) -> Path:
        """The path of a named file. Raises RequestError if the name leads out of the folder."""
        return self.containment.resolve(name, str(self.root))

    def report(self, kind: str, file: str, detail: str = "") -> None:
        """Add an issue."""
        self.issues.append(InputIssue(kind, file, detail))

    def has_image(self, name: str, where: str = "", what: str = "image") -> bool:
        """Whether a named image exists; reports it as missing otherwise.

        `where` is the place that names it, `what` the image's kind in the report. Raises
        RequestError if the name leads out of the folder.
        """
        where = where or str(self.root)
        if self.containment.find_file(name, where) is not None:
            return True
        self.report(f"missing {what}", name, f"named in {where}")
        return False

    def require_frames(self) -> None:
        """Raise RequestError, with the first issues, if no trajectory has a frame."""
        if any(len(trajectory.frames) for trajectory in self.trajectories.values()):
            return
        message = f"{self.root}: no usable image of layout {self.layout}"
        if self.issues:
            examples = {issue.kind: str(issue) for issue in reversed(self.issues)}
            ((kind, _),) = Counter(issue.kind for issue in self.issues).most_common(1)
            shown = dict.fromkeys([kind, self.issues[0].kind])
            texts = "; ".join(examples[each] for each in shown)
            message += f" ({counted(len(self.issues), 'issue')}, such as {texts})"
        if any("depth image" in issue.kind for issue in self.issues):
            message += f"; {WITHOUT_DEPTH}"
        raise RequestError(message)

    def finish(self, options: ReadOptions) -> Recording:
        """Keep the requested trajectories, and their frames whose poses are usable.

        The other frames are reported, and times that are not usable or in disorder.

        Rotations become exact. Raises RequestError if a requested trajectory is unknown, if no
        frame is usable, and for cameras that cannot exist.
        """
        names = list(self.trajectories)
        if names:
            names = choose_trajectories(options.trajectories, names, self.root)
        trajectories = {name: self._usable(self.trajectories[name]) for name in names}
        for name, trajectory in trajectories.items():
            if not len(trajectory.frames):
                self.report("empty trajectory", name, "no usable image")
        self.trajectories = {n: each for n, each in trajectories.items() if len(each.frames)}
        self.require_frames()
        self.camera.checked(f"{self.root}: camera")
        if self.depth_camera is not None:
            self.depth_camera.checked(f"{self.root}: depth camera")
        return self

    def _usable(self, trajectory: RecordedTrajectory) -> RecordedTrajectory:
        """The frames of a trajectory that have usable poses."""
        frames, poses, times = trajectory.frames, trajectory.poses, trajectory.timestamps

        def image(row: int) -> str:
            return frames[row].rgb.name

        usable = report_unusable(poses, trajectory.place or image, self.issues)
        if not usable.all():
            frames = chosen(frames, np.flatnonzero(usable).tolist())
            poses, times = poses[usable], times[usable]
        bad = np.flatnonzero(np.abs(times) > _LATEST)  # not the unknown ones, which are NaN
        if bad.size:
            detail = f"{times[bad[0]]:g} s; {counted(bad.size, 'time')} not usable"
            self.report("bad time", frames[int(bad[0])].rgb.name, detail)
            times = np.where(np.abs(times) > _LATEST, np.nan, times)
        late = np.flatnonzero(np.diff(times) <= 0)
        if late.size:
            detail = f"{counted(late.size, 'time')} not later than the one before; kept"
            self.report("times not in order", frames[int(late[0]) + 1].rgb.name, detail)
        return RecordedTrajectory(frames, orthonormal(poses), times)


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """Options of a reader.

    `values` are those of the layout by name, as text. `trajectories` are the requested ones, all by
    default. `allow_outside` admits files outside of the recording's folder.
    """

    values: Mapping[str, str] = field(default_factory=dict)
    trajectories: tuple[str, ...] = ()
    allow_outside: bool = False

    @property
    def reads_depth(self) -> bool:
        """Whether depth images are read; the option `depth`, whose only value is none, says not.

        Raises RequestError for another value.
        """
        value = self.values.get("depth")
        if value not in (None, "none"):
            raise RequestError(f"option depth={value}: only none, for recordings without depth")
        return value is None

    @property
    def named_depth(self) -> str | None:
        """The value of the option `depth`; None if it is not given, or `none`."""
        value = self.values.get("depth")
        return None if value == "none" else value

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


DEPTH_OPTION = "none: only colour images are read"
"""Description of the option `depth` of layouts whose recordings usually have depth."""
WITHOUT_DEPTH = "option depth=none reads the colour images alone"
"""What a message about missing depth images advises."""

ReadRecording = Callable[[Path, ReadOptions], Recording]


@dataclass(frozen=True, slots=True)
class Layout:
    """A layout of recordings: its reader, what it is, and the options that it takes.

    `options` maps the name of each option to its description.
    """

    read: ReadRecording
    description: str
    options: Mapping[str, str] = field(default_factory=dict)


def existing_folder(path: Path) -> Path:
    """The path. Raises RequestError unless it is a folder."""
    if not path.is_dir():
        kind = "not a folder" if path.exists() else "no such folder"
        raise RequestError(f"{path}: {kind}")
    return path


def folder_name(path: Path) -> str:
    """The name of a folder, also of `.`, as it is reported."""
    return path.name or path.resolve().name or "recording"


def trajectory_name(text: str) -> str:
    """The text as the name of a trajectory: other characters than letters and digits are `_`."""
    name = re.sub(r"\.\.+", ".", re.sub(r"[^A-Za-z0-9_.+-]", "_", text)).lstrip("_.+-")
    return name[:_MAX_NAME] or "recording"


def natural_order(name: str) -> list[tuple[int, str]]:
    """The key that sorts names by the numbers in them, so that 2.png comes before 10.png."""
    parts = ((number.lstrip("0"), text) for number, text in _PARTS.findall(name))
    return [(-1, text) if text else (len(number), number) for number, text in parts]
