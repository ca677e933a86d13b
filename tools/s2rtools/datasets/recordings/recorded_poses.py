"""Poses of recordings: conversion to matrices, checks, and poses at the times of images."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from s2rtools.common.input_issue import InputIssue

MAX_NORM_ERROR = 1e-2
"""Deviation from 1 of a quaternion's norm that rounding in a text file explains."""
MAX_ROTATION_ERROR = 1e-2
"""Largest element of R^T R - 1 that rounding in a text file explains."""
MAX_COORDINATE = 1e6
"""Metres."""
_FORWARD_TO_OPTICAL = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""A camera's axes x right, y down, z forward in axes x forward, y left, z up."""
_MAX_SHEAR = 1e-9
"""Largest relative deviation of a 3 x 3 matrix that counts as a scaled rotation."""
_LAST_ROW = np.array([0.0, 0.0, 0.0, 1.0])
_MAX_LAST_ROW_ERROR = 1e-6
_BLOCK = 1 << 14
"""Poses that are handled at a time."""


def poses_from_quaternions(
    positions: NDArray[np.float64], quaternions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(N, 3) metres and (N, 4) in order x, y, z, w -> (N, 4, 4).

    Quaternions are normalised if their norm is within `MAX_NORM_ERROR` of 1. Rotations of others
    are scaled by the norm, or NaN, so that `usable_poses` refuses them.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        norms = np.linalg.norm(quaternions, axis=1)
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, 3] = positions
    poses[:, :3, :3] = np.where(np.isfinite(norms), 0.0, np.nan)[:, None, None]
    turned = (norms > 0) & np.isfinite(norms)
    poses[turned, :3, :3] = Rotation.from_quat(quaternions[turned]).as_matrix()
    scaled = turned & ~(np.abs(norms - 1) <= MAX_NORM_ERROR)
    poses[scaled, :3, :3] *= norms[scaled, None, None]
    return poses


def level_poses(states: NDArray[np.float64], height: float) -> NDArray[np.float64]:
    """Camera poses (N, 4, 4) of robots at x, y, heading (N, 3), metres and radians; NaN as there.

    The camera looks along the heading, level, at `height` metres.
    """
    poses = np.tile(np.eye(4), (len(states), 1, 1))
    finite = np.isfinite(states[:, 2])
    turns = np.outer(states[finite, 2], [0.0, 0.0, 1.0])
    poses[finite, :3, :3] = Rotation.from_rotvec(turns).as_matrix()
    poses[~finite] = np.nan
    poses[:, :2, 3], poses[:, 2, 3] = states[:, :2], height
    return in_optical_axes(poses)


def in_optical_axes(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (N, 4, 4) of cameras whose axes are x right, y down, z forward.

    Those of the given `poses` are x forward, y left, z up.
    """
    result = poses.copy()
    result[:, :3, :3] = poses[:, :3, :3] @ _FORWARD_TO_OPTICAL
    return result


def usable_poses(poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N, 4, 4) -> (N,): whether a pose is finite, in range, and its rotation proper."""
    usable = np.asarray(np.isfinite(poses).all(axis=(1, 2)))
    for block in _blocks(len(poses)):
        rotations = poses[block, :3, :3]
        with np.errstate(invalid="ignore", over="ignore"):
            products = np.swapaxes(rotations, 1, 2) @ rotations
            proper = np.abs(products - np.eye(3)).max(axis=(1, 2)) <= MAX_ROTATION_ERROR
            proper &= np.linalg.det(np.nan_to_num(rotations)) > 0
            proper &= np.abs(poses[block, :3, 3]).max(axis=1) <= MAX_COORDINATE
            proper &= np.abs(poses[block, 3] - _LAST_ROW).max(axis=1) <= _MAX_LAST_ROW_ERROR
        usable[block] &= proper
    return usable


def pose_defect(pose: NDArray[np.float64]) -> str:
    """Why `usable_poses` refuses a pose (4, 4)."""
    rotation = pose[:3, :3]
    if not np.isfinite(pose).all():
        return "its values are not finite"
    if np.abs(pose[3] - _LAST_ROW).max() > _MAX_LAST_ROW_ERROR:
        return f"its last row is {' '.join(f'{value:g}' for value in pose[3])}, expected 0 0 0 1"
    with np.errstate(over="ignore", invalid="ignore"):
        product = rotation.T @ rotation
        error = float(np.abs(product - np.eye(3)).max())
        square = float(product[0, 0])
        is_scaled = float(np.abs(product - square * np.eye(3)).max()) <= _MAX_SHEAR * square
    if not error <= MAX_ROTATION_ERROR:
        if is_scaled:
            return f"the norm of its quaternion or axes is {math.sqrt(square):.4g}, expected 1"
        return f"its rotation is not orthonormal (R^T R deviates from 1 by {error:.3g})"
    if np.linalg.det(rotation) <= 0:
        return "its rotation mirrors"
    distance = float(np.abs(pose[:3, 3]).max())
    limit = f"at most {MAX_COORDINATE:,.0f} m are read; subtract an offset"
    return f"{distance:,.0f} m from the origin; {limit}"


def report_unusable(
    poses: NDArray[np.float64], place: Callable[[int], str], issues: list[InputIssue]
) -> NDArray[np.bool_]:
    """(N,): which of the poses (N, 4, 4) are usable; the others are reported at `place(row)`.

    One of -inf is none at all: the recording lost its track.
    """
    usable = usable_poses(poses)
    for row in np.flatnonzero(~usable).tolist():
        if np.isneginf(poses[row]).any():
            detail = "-inf: the recording lost its track here"
            issues.append(InputIssue("no pose", place(row), detail))
        else:
            issues.append(InputIssue("bad pose", place(row), pose_defect(poses[row])))
    return usable


def orthonormal(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Usable poses (N, 4, 4) with exact rotations, the nearest ones in the Frobenius norm."""
    result = poses.copy()
    result[:, 3] = _LAST_ROW
    for block in _blocks(len(poses)):
        u, _, vt = np.linalg.svd(poses[block, :3, :3])
        result[block, :3, :3] = u @ vt
    return result


def _blocks(count: int) -> Iterator[slice]:
    """Slices that cut `count` rows, so that intermediate results stay small."""
    for start in range(0, count, _BLOCK):
        yield slice(start, start + _BLOCK)


def poses_at(
    times: NDArray[np.float64],
    known_times: NDArray[np.float64],
    known_poses: NDArray[np.float64],
    max_gap: float,
    max_hold: float | None = None,
) -> NDArray[np.float64]:
    """Poses (N, 4, 4) at `times` (N,) seconds; `known_times` (K,) ascend, at their poses (K, 4, 4).

    Positions are interpolated linearly and rotations along the shortest arc (slerp). A time within
    `max_hold` seconds, by default `max_gap` / 2, before the first or behind the last known one
    takes that pose. NaN at other times and between known poses that are more than `max_gap` seconds
    apart.
    """
    max_hold = max_gap / 2 if max_hold is None else max_hold
    result = np.full((len(times), 4, 4), np.nan)
    if not len(known_times):
        return result
    nearest = nearest_times(times, known_times, np.inf)
    distance = np.abs(known_times[nearest] - times)
    inside = (times > known_times[0]) & (times < known_times[-1])
    alone = (distance == 0) | (~inside & (distance <= max_hold))
    result[alone] = known_poses[nearest[alone]]
    between = inside & ~alone
    right = np.searchsorted(known_times, times[between])
    between[between] = np.diff(known_times)[right - 1] <= max_gap
    if between.any():
        rotations = Slerp(known_times, Rotation.from_matrix(known_poses[:, :3, :3]))
        result[between] = np.eye(4)
        result[between, :3, :3] = rotations(times[between]).as_matrix()
        for axis in range(3):
            result[between, axis, 3] = np.interp(
                times[between], known_times, known_poses[:, axis, 3]
            )
    return result


def poses_near(
    times: NDArray[np.float64],
    known_times: NDArray[np.float64],
    known_poses: NDArray[np.float64],
    tolerance: float,
) -> NDArray[np.float64]:
    """Poses (N, 4, 4) at `times`, from known poses within `tolerance` seconds; arguments as above.

    Where the known poses before and after a time are both within the tolerance, the pose is
    interpolated. Where only one is, that pose is taken as it is. NaN where none is.
    """
    result = np.full((len(times), 4, 4), np.nan)
    rows = nearest_times(times, known_times, tolerance)
    near = rows >= 0
    result[near] = known_poses[rows[near]]
    right = np.searchsorted(known_times, times)
    inside = (right > 0) & (right < len(known_times))
    between = np.zeros(len(times), dtype=bool)
    before, after = known_times[right[inside] - 1], known_times[right[inside]]
    inner = times[inside]
    between[inside] = (inner - before <= tolerance) & (after - inner <= tolerance)
    result[between] = poses_at(times[between], known_times, known_poses, 2 * tolerance)
    return result


def nearest_times(
    times: NDArray[np.float64], known_times: NDArray[np.float64], tolerance: float
) -> NDArray[np.intp]:
    """The row of the nearest of `known_times` (K,), ascending, for each time; -1 for none.

    A row counts if it is within `tolerance` seconds.
    """
    if not len(known_times):
        return np.full(len(times), -1, dtype=np.intp)
    right = np.minimum(np.searchsorted(known_times, times), len(known_times) - 1)
    left = np.maximum(right - 1, 0)
    is_nearer_left = np.abs(times - known_times[left]) < np.abs(known_times[right] - times)
    rows = np.where(is_nearer_left, left, right)
    return np.where(np.abs(known_times[rows] - times) <= tolerance, rows, -1)


def mutual_nearest(
    times: NDArray[np.float64], known_times: NDArray[np.float64], tolerance: float
) -> NDArray[np.intp]:
    """As `nearest_times`, but one to one: each time must be the nearest of the known one, too.

    Both arrays ascend.
    """
    rows = nearest_times(times, known_times, tolerance)
    if not len(known_times):
        return rows
    back = nearest_times(known_times, times, tolerance)
    return np.where((rows >= 0) & (back[rows] == np.arange(len(times))), rows, -1)
