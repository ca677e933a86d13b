"""Pose in the lane from detected segments, by a vote over offset and heading.

Each white or yellow segment is projected to the road. Its direction gives a heading, and its
distance from the robot, with the known place of its line in the lane, an offset; the normal, which
points into the line, tells its two edges apart. The cell of the (offset, heading) grid with the
most votes, refined by the mean of the votes near it, is the pose. Source of the idea: the histogram
filter of Paull et al., "Duckietown: an open, inexpensive and flexible platform for autonomy
education and research", 2017; here for one image, without a motion model.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from examples.duckietown.fisheye_camera import FisheyeCamera
from examples.duckietown.line_detector import Segments
from examples.duckietown.road_map import LANE_OFFSET, WHITE_OFFSET, WHITE_WIDTH, YELLOW_WIDTH
from examples.duckietown.road_renderer import LanePose

Floats = NDArray[np.float64]

_NEAR = 0.5
"""Metres ahead up to which segments vote: beyond it a bend looks like a heading."""
_OFFSETS = np.linspace(-0.2, 0.2, 41)
_HEADINGS = np.linspace(-1.0, 1.0, 41)
_MIN_VOTES = 3.0
_RIGHT, _LEFT = -1.0, 1.0


def lane_pose(segments: dict[str, Segments], camera: FisheyeCamera) -> LanePose | None:
    """The pose in the lane, or None where too few segments agree."""
    votes = np.concatenate(
        [
            _votes(segments["white"], camera, -(WHITE_OFFSET - LANE_OFFSET), WHITE_WIDTH, _RIGHT),
            _votes(segments["yellow"], camera, LANE_OFFSET, YELLOW_WIDTH, _LEFT),
        ]
    )
    inside = (np.abs(votes[:, 0]) < _OFFSETS[-1]) & (np.abs(votes[:, 1]) < _HEADINGS[-1])
    votes = votes[inside]
    if votes[:, 2].sum() < _MIN_VOTES:
        return None
    bins = (_edges(_OFFSETS), _edges(_HEADINGS))
    grid, _, _ = np.histogram2d(votes[:, 0], votes[:, 1], bins=bins, weights=votes[:, 2])
    smooth = cv2.GaussianBlur(grid, (0, 0), 1.5)
    at = np.unravel_index(int(smooth.argmax()), smooth.shape)
    best = np.array([_OFFSETS[at[0]], _HEADINGS[at[1]]])
    near = (np.abs(votes[:, :2] - best) < [0.03, 0.15]).all(axis=1)
    if not near.any():
        return LanePose(float(best[0]), float(best[1]))
    offset, heading = np.average(votes[near, :2], axis=0, weights=votes[near, 2])
    return LanePose(float(offset), float(heading))


def _votes(
    segments: Segments, camera: FisheyeCamera, middle: float, width: float, side: float
) -> Floats:
    """Votes (n, 3): offset, heading and weight, of segments of a line whose middle lies `middle`
    metres to the left of the lane's; `side` is -1 for the line on the right."""
    if not len(segments):
        return np.zeros((0, 3))
    points = segments.points.astype(np.float64)
    inward = points.reshape(-1, 2, 2).mean(axis=1) + segments.normals
    start, end, into = (camera.to_ground(each) for each in (points[:, :2], points[:, 2:], inward))
    along = end - start
    backward = along[:, 0] < 0
    along[backward] *= -1
    length = np.linalg.norm(along, axis=1)
    direction = along / np.maximum(length, 1e-9)[:, None]
    left = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    centre = (start + end) / 2
    distance = (centre * left).sum(axis=1)
    line_on_left = ((into - centre) * left).sum(axis=1) > 0
    edge = np.where(line_on_left, -width / 2, width / 2)
    votes = np.stack(
        [middle + edge - distance, -np.arctan2(direction[:, 1], direction[:, 0]),
         np.minimum(length, 0.1) / 0.02], axis=1
    )  # fmt: skip
    ahead = (centre[:, 0] > 0) & (centre[:, 0] < _NEAR) & (length > 0.005)
    return votes[ahead & np.isfinite(votes).all(axis=1) & (np.sign(distance) == side)]


def _edges(centres: Floats) -> Floats:
    step = centres[1] - centres[0]
    return np.append(centres - step / 2, centres[-1] + step / 2)
