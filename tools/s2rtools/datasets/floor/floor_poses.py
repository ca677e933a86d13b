"""6-DoF poses of a recording on the floor: position, heading, and what does not fit on a plane.

The floor's axes are right-handed: x and y in the plane, z upwards, z = 0 on the floor, metres. They
follow from those of the recording's world by the smallest rotation that turns up into z: a world
whose z points up keeps its x and y; one whose y points up keeps x, and its -z becomes y.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.floor import ground_plane
from s2rtools.datasets.recording import Recording

Floats = NDArray[np.float64]

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_NO_HEADING = math.radians(5)
"""Angle between the optical axis and the vertical below which a frame has no heading."""
_LEVEL = math.radians(0.5)
"""Deviation of the cameras' horizontal axes up to which poses alone determine the up axis best."""
_TILT_MEDIAN, _TILT_MAX = math.radians(1.0), math.radians(5.0)
"""Tilt, in the median and at most, beyond which a camera is reported as not level."""
_SAME_HEIGHT, _SAME_ANGLE = 0.05, math.radians(1.0)
"""Metres and radians by which height, pitch and tilt of a camera may differ between recordings,
beside how they vary in the stored one."""
_IMPLAUSIBLE_EXTENT, _IMPLAUSIBLE_STEP, _IMPLAUSIBLE_STEP_IF_TIMELESS = 1000.0, 10.0, 3.0
"""Metres above which positions are refused unless the scale of the world is stated: the larger edge
of the map together with the median distance of consecutive images, with or without times."""
_IMPLAUSIBLE_SPEED, _LEAST_EXTENT = 50.0, 100.0
"""Metres per second in the median, together with metres of the larger edge, likewise."""
_IMPLAUSIBLE_HEIGHT = 100.0
"""Metres of the camera above the floor, likewise."""
_INCLINED = math.radians(5)
"""Angle between the up axis and the fitted floor that is reported."""
_MOST_METRES_PER_UNIT, _MOST_GROUND, _MOST_HEIGHT = 1e6, 1e6, 1000.0
"""Largest scale of a world (its inverse is the smallest), height of a floor in units of the world,
and height of cameras in metres."""


@dataclass(frozen=True, slots=True)
class FloorOptions:
    """How poses are put on the floor.

    `up` is the direction against gravity in the world's axes: "z", "-y" or three numbers; by
    default the layout's, else fitted. `ground` is the floor's height along it in units of the
    world; by default fitted to depth. `camera_height` is that of the cameras above the floor in
    metres, in the median; it replaces `ground`. `metres_per_unit` is the scale of the world, by
    default 1.
    """

    up: str | Sequence[float] | None = None
    ground: float | None = None
    camera_height: float | None = None
    metres_per_unit: float | None = None


class FloorPoses:
    """The poses of a recording on the floor, by trajectory, a row for every frame.

    `poses` (N, 3) are x, y in metres and heading in radians in [-pi, pi), the direction of the
    optical axis on the floor; y grows to the left of x, so that maps have `y_down` = False. Rows
    of frames that look straight up or down are NaN and in `issues`. `cameras` (N, 4, 4) are the
    full poses in the floor's axes, metres. `median_height` is that of the cameras in these axes,
    `camera_height` that above the floor, NaN where it is unknown, and `height_spread` the distance
    of the 5th and the 95th percentile. `pitch` is the median, radians, positive where the camera
    looks upwards. `tilt_median` and `tilt_max` are angles, in radians, between the cameras and
    level ones of that pitch. `world_to_floor` (4, 4) maps points of the world; it scales them by
    `metres_per_unit`. `up_source` says where the up axis comes from, `report` is for the user.
    """

    def __init__(
        self, recording: Recording, world_to_floor: Floats, metres_per_unit: float, up_source: str
    ) -> None:
        """Raises RequestError if no image has a pose, or all look straight up or down."""
        if not any(len(t.poses) for t in recording.trajectories.values()):
            raise RequestError(f"{recording.name}: no image has a pose")
        self.world_to_floor, self.metres_per_unit = world_to_floor, metres_per_unit
        self.up, self.up_source = world_to_floor[2, :3] / metres_per_unit, up_source
        self.report: tuple[str, ...] = ()
        self.cameras = {
            name: _moved(trajectory.poses, world_to_floor, metres_per_unit)
            for name, trajectory in recording.trajectories.items()
        }
        self.poses = {name: _on_floor(each) for name, each in self.cameras.items()}
        everything = np.concatenate(list(self.cameras.values()))
        self.pitch, tilt = _tilt(everything, np.concatenate(list(self.poses.values()))[:, 2])
        heights = np.percentile(everything[:, 2, 3], [5, 50, 95])
        self.camera_height = self.median_height = float(heights[1])
        self.height_spread = float(heights[2] - heights[0])
        self.tilt_median, self.tilt_max = float(np.median(tilt)), float(tilt.max())
        self._tilt_text = (
            f"tilt {math.degrees(self.tilt_median):.1f} degrees in the median, at most "
            f"{math.degrees(self.tilt_max):.1f}"
        )
        self.issues = _without_heading(recording, self.poses)
        if self.tilt_median > _TILT_MEDIAN or self.tilt_max > _TILT_MAX:
            detail = f"{self._tilt_text}; roll and changes of pitch are not on the floor plan"
            self.issues.append(InputIssue("camera not level", recording.name, detail))

    def usable(self, trajectory: str) -> NDArray[np.bool_]:
        """Which frames of a trajectory have a pose on the floor, (N,)."""
        return np.asarray(np.isfinite(self.poses[trajectory]).all(axis=1))

    def camera_text(self, is_height_known: bool) -> str:
        """Height, pitch and tilt of the cameras in words."""
        height = f"{self.median_height:.3f} m above it" if is_height_known else "height unknown"
        return (
            f"camera {height} ({self.height_spread:.3f} m between the 5th and the 95th "
            f"percentile), pitch {math.degrees(self.pitch):.2f} degrees, {self._tilt_text}"
        )


@dataclass(frozen=True, slots=True, eq=False)
class FittedScale:
    """The factor by which `metres_per_unit` of an earlier projection `floor` is multiplied."""

    floor: FloorPoses
    factor: float


@dataclass(frozen=True, slots=True, eq=False)
class StoredFloor:
    """The floor of a stored recording's world, and how its camera stands on it.

    See `FloorPoses`; `camera_height` is NaN where it is unknown.
    """

    world_to_floor: Floats
    metres_per_unit: float
    camera_height: float
    height_spread: float
    pitch: float
    tilt_median: float


def parse_up(up: str | Sequence[float]) -> Floats:
    """A unit vector (3,) of "z", "-y" or three numbers. Raises RequestError for anything else."""
    if isinstance(up, str):
        name = up.strip().lower()
        sign, name = (-1.0 if name.startswith("-") else 1.0), name.lstrip("+-")
        numbers: Sequence[object] = _AXES.get(name) or up.replace(",", " ").split()
        sign = sign if name in _AXES else 1.0
    else:
        sign, numbers = 1.0, up
    try:
        vector = sign * np.array([float(str(number)) for number in numbers])
    except ValueError:
        vector = np.empty(0)
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not math.isfinite(length) or length < 1e-9:
        raise RequestError(f"up {up!r}: give x, y or z, with - for its opposite, or three numbers")
    return np.asarray(vector / length + 0.0)


def project_to_floor(
    recording: Recording, options: FloorOptions | None = None, scale: FittedScale | None = None
) -> FloorPoses:
    """Put the poses of all trajectories on the floor of their world.

    Without a declared up axis, that of the layout counts. Without one, it is fitted to the poses
    of a level camera, else to the floor in depth images, else to the poses of any camera (see
    `ground_plane.up_from_poses` and `ground_plane.fit_floor`). With `scale`, the up axis is that of
    the earlier projection. Raises RequestError if the up axis is not determined, if an option is
    invalid, or if the positions are implausible in metres and no option states their unit.
    """
    options = options or FloorOptions()
    stated = options.metres_per_unit
    unit = (1.0 if stated is None else stated) * (scale.factor if scale else 1.0)
    if not 1 / _MOST_METRES_PER_UNIT <= unit <= _MOST_METRES_PER_UNIT:
        low, high = 1 / _MOST_METRES_PER_UNIT, _MOST_METRES_PER_UNIT
        raise RequestError(f"metres_per_unit {unit:g}: must be a number from {low:g} to {high:g}")
    if not any(len(t.poses) for t in recording.trajectories.values()):
        raise RequestError(f"{recording.name}: no image has a pose")
    all_poses = np.concatenate([t.poses for t in recording.trajectories.values()])
    needs_points = options.up is None and recording.up is None
    needs_points |= options.ground is None and options.camera_height is None
    points, frames = (
        ground_plane.depth_points(recording, unit) if needs_points else (np.empty((0, 3)), 0)
    )
    tolerance = ground_plane.point_tolerance(recording, unit)
    if scale is None:
        up, how = _up(recording, options, all_poses, points, tolerance)
    else:
        up, how = scale.floor.up, scale.floor.up_source
    heights = all_poses[:, :3, 3] @ up
    issues: list[InputIssue] = []
    ground, ground_text = _ground(options, unit, up, heights, all_poses, points, tolerance)
    if math.isnan(ground):
        ground_text = "floor not known; give ground or camera_height"
    elif frames and options.ground is None and options.camera_height is None:
        ground_text += f" of {frames} frames"
        issues += _inclination(recording, up, all_poses, points, tolerance)
    world_to_floor = _world_to_floor(up, 0.0 if math.isnan(ground) else ground, unit)
    floor = FloorPoses(recording, world_to_floor, unit, how)
    floor.issues[:0] = issues
    if math.isnan(ground):
        floor.camera_height = math.nan
    if stated is None and scale is None and recording.is_metric:
        _refuse_implausible(recording, floor, options.camera_height is not None)
    if not recording.is_metric and unit == 1.0 and scale is None:
        own, name = recording.scale_option, recording.layout
        advice = f"option {own} of layout {name}" if own else "metres_per_unit"
        detail = f"the layout leaves it open; give {advice}"
        floor.issues.append(InputIssue("scale of the world not known", recording.name, detail))
    floor.report = (
        f"up {', '.join(f'{value:.4f}' for value in up)} ({how}); {ground_text}",
        floor.camera_text(not math.isnan(ground)),
    )
    if scale is not None:
        floor.report += (f"scale fitted to the pairs: {unit:.6g} metres per unit of the world",)
    return floor


def _refuse_implausible(recording: Recording, floor: FloorPoses, is_height_stated: bool) -> None:
    """Raise RequestError for positions that are hardly in metres, as those in millimetres."""
    name, above = recording.name, floor.camera_height
    where = "in --floor, --sim-floor or --real-floor"
    if is_height_stated and above > _IMPLAUSIBLE_HEIGHT:
        raise RequestError(
            f"{name}: camera_height {above:g} looks like millimetres; give metres, or "
            f"metres_per_unit=1 {where} if they are metres"
        )
    positions = [cameras[:, :2, 3] for cameras in floor.cameras.values()]
    edges = np.ptp(np.concatenate(positions), axis=0)
    steps = [np.linalg.norm(np.diff(each, axis=0), axis=1) for each in positions]
    seconds = [np.diff(recording.trajectories[each].timestamps) for each in floor.cameras]
    speeds = [s[t > 0] / t[t > 0] for s, t in zip(steps, seconds, strict=True)]
    step, speed = _median(steps, math.inf), _median(speeds, 0.0)
    largest_step = _IMPLAUSIBLE_STEP if speed else _IMPLAUSIBLE_STEP_IF_TIMELESS
    is_large = edges.max() > _IMPLAUSIBLE_EXTENT and step > largest_step
    is_fast = edges.max() > _LEAST_EXTENT and speed > _IMPLAUSIBLE_SPEED
    if is_large or is_fast or above > _IMPLAUSIBLE_HEIGHT:
        height = "" if math.isnan(above) else f", {above:.0f} m above the floor"
        pace = f" at {speed:,.0f} m/s" if speed else ""
        raise RequestError(
            f"{name}: poses look like millimetres: they would cover {edges[0]:,.0f} m x "
            f"{edges[1]:,.0f} m{pace}{height}; give metres_per_unit=0.001 (0.01 for centimetres) "
            f"{where}, or 1 if they are metres"
        )


def _median(parts: Sequence[Floats], default: float) -> float:
    values = np.concatenate(parts)
    return float(np.median(values)) if len(values) else default


def put_on_stored_floor(recording: Recording, stored: StoredFloor, side: str) -> FloorPoses:
    """Put the poses of all trajectories on the floor of a world that they share with stored ones.

    Height and pitch of the camera are the stored ones. Raises RequestError where it stands on the
    floor in another way than the stored one: its world or the camera is another one.
    """
    how = "of the store"
    floor = FloorPoses(recording, stored.world_to_floor, stored.metres_per_unit, how)
    tilt, spread, height = stored.tilt_median, stored.height_spread, stored.camera_height
    text = floor.camera_text(math.isfinite(height))
    differs = (
        abs(floor.median_height - height) > _SAME_HEIGHT + spread  # False where height is NaN
        or floor.height_spread > 2 * spread + 2 * _SAME_HEIGHT
        or abs(floor.pitch - stored.pitch) > _SAME_ANGLE + tilt
        or floor.tilt_median > _SAME_ANGLE + 2 * tilt
    )
    if differs:
        known = "height unknown" if math.isnan(height) else f"{height:.3f} m"
        raise RequestError(
            f"{side} recording {recording.name}: on the floor of the store: {text}; the stored "
            f"camera: {known} ({spread:.3f} m), pitch {math.degrees(stored.pitch):.2f} degrees, "
            f"tilt {math.degrees(tilt):.1f} degrees; append what is recorded in the world of the "
            "store, by the same camera"
        )
    floor.camera_height, floor.pitch = height, stored.pitch
    floor.report = (f"floor {how}", text)
    return floor


def _without_heading(recording: Recording, poses: dict[str, Floats]) -> list[InputIssue]:
    """An issue for each frame that looks straight up or down."""
    return [
        InputIssue(
            "no heading",
            recording.trajectories[name].frames[int(row)].rgb.name,
            "the camera looks straight up or down",
        )
        for name, each in poses.items()
        for row in np.flatnonzero(np.isnan(each[:, 2]))
    ]


def _up(
    recording: Recording, options: FloorOptions, poses: Floats, points: Floats, tolerance: float
) -> tuple[Floats, str]:
    """The unit vector against gravity in the world's axes, and where it comes from."""
    if options.up is not None:
        return parse_up(options.up), "declared"
    if recording.up is not None:
        return parse_up(recording.up), f"of the layout {recording.layout}"
    fitted = ground_plane.up_from_poses(poses)
    if fitted is not None and fitted.deviation <= _LEVEL:
        return fitted.up, f"fitted to the {fitted.method}"
    upright = -poses[:, :3, 1].mean(axis=0) if fitted is None else fitted.up
    length = float(np.linalg.norm(upright))
    if length > 0.5:
        floor = ground_plane.fit_floor(points, poses[:, :3, 3], upright / length, tolerance)
        if floor is not None:
            share = f"{100 * floor.share:.0f} % of the depth points below the cameras"
            return floor.normal, f"fitted to the floor, {share}"
    if fitted is not None:
        deviation = math.degrees(fitted.deviation)
        return fitted.up, f"fitted to the {fitted.method}, which deviate by {deviation:.1f} degrees"
    raise RequestError(
        f"{recording.name}: poses and depth do not determine which way is up; give up, such as z"
    )


def _ground(
    options: FloorOptions, unit: float, up: Floats, heights: Floats, poses: Floats,
    points: Floats, tolerance: float,
) -> tuple[float, str]:  # fmt: skip
    """The floor's height along `up` in units of the world, NaN if unknown, and its source.

    `unit` is metres per unit of the world.
    """
    if options.camera_height is not None:
        if not 0 < options.camera_height <= _MOST_HEIGHT:
            text = f"must be a positive number of metres, at most {_MOST_HEIGHT:g}"
            raise RequestError(f"camera_height {options.camera_height:g}: {text}")
        below = options.camera_height / unit
        return float(np.median(heights)) - below, "floor by the declared height of the cameras"
    if options.ground is not None:
        if not abs(options.ground) <= _MOST_GROUND:
            limits = f"from {-_MOST_GROUND:g} to {_MOST_GROUND:g}"
            raise RequestError(f"ground {options.ground:g}: must be a number {limits}")
        return options.ground, f"floor declared at {options.ground:g}"
    found = ground_plane.floor_height(points, poses[:, :3, 3], up, tolerance)
    if found is None:
        return math.nan, ""
    height, share = found
    text = f"floor at {height:.3f}, {100 * share:.0f} % of the points below the cameras in depth"
    return height, text


def _inclination(
    recording: Recording, up: Floats, poses: Floats, points: Floats, tolerance: float
) -> list[InputIssue]:
    """An issue if the floor in depth images is inclined to the up axis."""
    floor = ground_plane.fit_floor(points, poses[:, :3, 3], up, tolerance)
    if floor is None:
        return []
    angle = math.acos(float(np.clip(floor.normal @ up, -1.0, 1.0)))
    if angle <= _INCLINED:
        return []
    normal = ", ".join(f"{value:.3f}" for value in floor.normal)
    detail = f"by {math.degrees(angle):.1f} degrees to the up axis; its normal is {normal}"
    return [InputIssue("floor inclined", recording.name, detail)]


def _world_to_floor(up: Floats, ground: float, unit: float) -> Floats:
    """(4, 4): the smallest rotation that turns `up` into z, the floor to z = 0, world to metres."""
    axis = np.cross(up, _AXES["z"])
    sine, largest = float(np.linalg.norm(axis)), float(np.abs(axis).max())
    axis = axis / largest if largest else np.array(_AXES["x"])
    axis /= np.linalg.norm(axis)  # in two steps, because squares of tiny numbers are 0
    rotation = Rotation.from_rotvec(math.atan2(sine, up[2]) * axis).as_matrix()
    result = np.eye(4)
    result[:3, :3] = unit * rotation
    result[2, 3] = -unit * ground
    return result


def _moved(poses: Floats, transform: Floats, unit: float) -> Floats:
    """Poses (N, 4, 4) in the floor's axes; their rotations are not scaled."""
    moved = np.asarray(transform @ poses)
    moved[:, :3, :3] /= unit
    return moved


def _on_floor(cameras: Floats) -> Floats:
    """x, y and heading (N, 3) of poses in the floor's axes; NaN without a heading."""
    forward = cameras[:, :3, 2]
    heading = angles.wrap(np.arctan2(forward[:, 1], forward[:, 0]))
    result = np.column_stack([cameras[:, 0, 3], cameras[:, 1, 3], heading])
    result[np.hypot(forward[:, 0], forward[:, 1]) < math.sin(_NO_HEADING)] = np.nan
    return result


def _tilt(cameras: Floats, headings: Floats) -> tuple[float, Floats]:
    """The median pitch, and the angles between cameras and level ones of that pitch, radians.

    Frames without a heading do not count. Raises RequestError if there are no others.
    """
    kept = np.isfinite(headings)
    if not kept.any():
        raise RequestError("all cameras look straight up or down; check the up axis")
    rotations, heading = cameras[kept, :3, :3], headings[kept]
    pitch = float(np.median(np.arcsin(np.clip(rotations[:, 2, 2], -1.0, 1.0))))
    cos, sin = np.cos(heading), np.sin(heading)
    zero = np.zeros_like(heading)
    forward = np.stack([cos * math.cos(pitch), sin * math.cos(pitch), zero + math.sin(pitch)], 1)
    right = np.stack([sin, -cos, zero], 1)
    level = np.stack([right, np.cross(forward, right), forward], axis=2)
    trace = (level * rotations).sum(axis=(1, 2))
    return pitch, np.arccos(np.clip((trace - 1) / 2, -1.0, 1.0))
