"""The up axis and the floor of a recording's world, fitted to its poses and its depth images."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.camera import sample_pixels
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.recording import PinholeCamera, RecordedImage, Recording

Floats = NDArray[np.float64]

FRAMES = 24
"""Depth images, spread evenly over the recording, whose points the floor is fitted to."""
_SAMPLES = 48
"""Depth pixels along each axis of an image that are back-projected."""
_FAR = 6.0
"""Metres of depth beyond which points are too noisy for a plane."""
_TOLERANCE = 0.03
"""Metres between a plane and its points, or one unit of raw depth if that is more."""
_TRIALS = 400
_MAX_TILT = np.radians(30)
"""Largest angle between the floor's normal and the direction in which images are upright."""
_PEAK = 0.25
"""Share of the points of the largest level surface that a lower one needs to be the floor."""
_LEAST_SHARE = 0.02
"""Share of the points below the cameras that the floor holds at least."""
_LEAST_POINTS = 200
_SPANNED = np.sin(np.radians(8)) ** 2
"""Mean square of the second axis of the directions that determine a plane."""
_CLEARER = 4.0
"""Ratio of the mean squares of the second and the third axis that determine a plane."""


@dataclass(frozen=True, slots=True, eq=False)
class FittedUp:
    """The direction against gravity, a unit vector (3,), and how it was found.

    `deviation` is the root mean square angle between the directions that are level on a level
    robot and the plane across `up`, radians.
    """

    up: Floats
    method: str
    deviation: float


@dataclass(frozen=True, slots=True, eq=False)
class FittedFloor:
    """A plane: its unit normal (3,), its height along it, in units of the world, and its support.

    `share` is that of the points below the cameras that lie on it.
    """

    normal: Floats
    height: float
    share: float


def up_from_poses(poses: Floats) -> FittedUp | None:
    """The up axis of poses (N, 4, 4) whose cameras do not roll; None if they do not determine it.

    The horizontal axes of level cameras lie in the plane of the floor, whatever their pitch: up is
    the direction in which these axes have the least mean square (the eigenvector of the smallest
    eigenvalue of the mean of x x^T). If the cameras turn too little for that, the directions of
    their centres from the mean centre count as well, with the same total weight. The sign is the
    one in which images are upright.
    """
    axes, centres = poses[:, :3, 0], poses[:, :3, 3]
    moment = axes.T @ axes / len(axes)
    away = centres - centres.mean(axis=0)
    extent = float((away**2).sum())
    found = _least_axis(moment)
    method = "horizontal axes of the cameras"
    if found is None and extent > 0:
        found = _least_axis((moment + away.T @ away / extent) / 2)
        method = "horizontal axes and centres of the cameras"
    if found is None:
        return None
    up, deviation = found
    upright = float(-(poses[:, :3, 1] @ up).mean())
    if abs(upright) < 0.5:
        return None
    return FittedUp(up * np.sign(upright), method, deviation)


def _least_axis(moment: Floats) -> tuple[Floats, float] | None:
    values, vectors = np.linalg.eigh(moment)
    values = np.maximum(values, 0.0)
    if values[1] < _SPANNED or values[1] < _CLEARER * values[0]:
        return None
    return vectors[:, 0], float(np.arcsin(min(1.0, np.sqrt(values[0]))))


def depth_points(recording: Recording, unit: float) -> tuple[Floats, int]:
    """Points (M, 3) of some depth images in the recording's world, and how many images gave them.

    `unit` is metres per unit of the world. Images that cannot be read are left out: ingest
    reports them.
    """
    trajectories = [t for t in recording.trajectories.values() if len(t.poses)]
    total = sum(len(trajectory.poses) for trajectory in trajectories)
    parts = []
    for trajectory in trajectories:
        rows = len(trajectory.poses)
        for row in spread_rows(rows, max(1, FRAMES * rows // total)):
            depth, pose = trajectory.frames[row].depth, trajectory.poses[row]
            points = None if depth is None else _image_points(recording, depth, pose, unit)
            if points is not None:
                parts.append(points)
    return (np.concatenate(parts) if parts else np.empty((0, 3))), len(parts)


def spread_rows(rows: int, count: int) -> list[int]:
    """At most `count` of a number of rows, evenly spread."""
    count = min(rows, count)
    return [int((k + 0.5) * rows / count) for k in range(count)]


def _image_points(
    recording: Recording, depth: RecordedImage, pose: Floats, unit: float
) -> Floats | None:
    """World points (m, 3) of one depth image; None if it is unusable."""
    image = depth.read()
    camera = recording.camera_of_depth
    if isinstance(image, InputIssue) or image.pixels.shape != (camera.height, camera.width):
        return None
    rows, cols = (sample_pixels(_SAMPLES, extent) for extent in image.pixels.shape)
    raw = image.pixels[rows[:, None], cols[None, :]].astype(np.float64)
    metres = raw * recording.metres_of_depth(unit)
    with np.errstate(invalid="ignore"):
        valid = (raw > 0) & (raw <= recording.depth_raw_max) & (metres < _FAR)
    u, v = np.meshgrid(cols + 0.5, rows + 0.5)
    slopes = normalized(camera, np.stack([u[valid], v[valid]], axis=1))
    away = metres[valid] / unit
    local = np.column_stack([slopes * away[:, None], away])
    return np.asarray(local @ pose[:3, :3].T + pose[:3, 3])


def normalized(camera: PinholeCamera, pixels: Floats) -> Floats:
    """x / z and y / z (m, 2) of continuous image coordinates (m, 2) of an image with distortion."""
    if not len(pixels):
        return np.empty((0, 2))
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    undistort = cv2.fisheye.undistortPoints if camera.is_fisheye else cv2.undistortPoints
    return np.asarray(
        undistort(pixels[:, None], matrix, camera.coefficients)[:, 0], dtype=np.float64
    )


def floor_height(
    points: Floats, centres: Floats, up: Floats, tolerance: float
) -> tuple[float, float] | None:
    """Height along `up` of the floor, and the share of the points below the cameras on it.

    The floor is the lowest level surface that holds at least `_PEAK` of the points of the largest
    one. None if no surface below the cameras has enough points.
    """
    heights = np.sort(points @ up)
    heights = heights[heights < np.median(centres @ up) - 2 * tolerance]
    if len(heights) < _LEAST_POINTS:
        return None
    steps = np.arange(heights[0], heights[-1] + tolerance, tolerance / 2)
    ends = np.searchsorted(heights, np.stack([steps - tolerance, steps + tolerance]))
    counts = ends[1] - ends[0]
    if counts.max() < _LEAST_SHARE * len(heights):
        return None
    first = int(np.argmax(counts >= _PEAK * counts.max()))
    best = first + int(np.argmax(counts[first : first + 7]))
    on_floor = heights[ends[0, best] : ends[1, best]]
    return float(np.median(on_floor)), len(on_floor) / len(heights)


def fit_floor(
    points: Floats, centres: Floats, upright: Floats, tolerance: float
) -> FittedFloor | None:
    """The floor under cameras at `centres` (N, 3) among `points` (M, 3); None if there is none.

    Random sample consensus over planes within `_MAX_TILT` of `upright` (3,), a unit vector; then
    the lowest level surface as in `floor_height`, and least squares over its points.
    Source of the method: Fischler and Bolles, Random Sample Consensus, 1981.
    """
    below = points[points @ upright < np.median(centres @ upright) - 2 * tolerance]
    if len(below) < _LEAST_POINTS:
        return None
    rng = np.random.default_rng(0)
    triples = below[rng.integers(len(below), size=(_TRIALS, 3))]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals /= lengths[:, None]
        normals *= np.sign(normals @ upright)[:, None]
        level = (lengths > 0) & (normals @ upright >= np.cos(_MAX_TILT))
    if not level.any():
        return None
    normals, corners = normals[level], triples[level, 0]
    sample = below[rng.permutation(len(below))[:4000]]
    near = np.abs(sample @ normals.T - (corners * normals).sum(axis=1)) <= tolerance
    normal = normals[int(np.argmax(near.sum(axis=0)))]
    for _ in range(5):
        found = floor_height(points, centres, normal, tolerance)
        if found is None:
            return None
        on_floor = below[np.abs(below @ normal - found[0]) <= tolerance]
        if len(on_floor) < 3:
            return None
        normal = np.linalg.svd(on_floor - on_floor.mean(axis=0), full_matrices=False)[2][2]
        normal = normal * np.sign(normal @ upright)
    found = floor_height(points, centres, normal, tolerance)
    return None if found is None else FittedFloor(normal, *found)


def point_tolerance(recording: Recording, unit: float) -> float:
    """Distance from a plane within which depth points count as on it, in units of the world."""
    return max(_TOLERANCE, recording.metres_of_depth(unit)) / unit
