"""Poses of a bag's camera, from a topic of poses or from transforms."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.common.bag_messages import ODOMETRY, BagMessages, pose_of, stamp_of
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.bags.frame_tree import FrameTree, PoseLog, plain
from s2rtools.datasets.bags.topics import TF, Topics, is_static
from s2rtools.datasets.recording import ReadOptions
from s2rtools.datasets.recordings.recorded_poses import in_optical_axes, poses_at

OPTICAL, FORWARD = "optical", "forward"
"""Values of the option `axes`."""
MAX_GAP = 0.2
"""Seconds between poses that are interpolated, by default."""


class CameraPoses:
    """Collects poses and transforms, and gives the camera's poses at the times of images.

    `world` is the frame of the poses that were given last, and `facts` states the frames.
    """

    def __init__(self, bag: BagMessages, topics: Topics, options: ReadOptions) -> None:
        """Raises RequestError for invalid options."""
        self._bag, self._topics, self._values = bag, topics, options.values
        self._axes = options.values.get("axes", OPTICAL)
        if self._axes not in (OPTICAL, FORWARD):
            raise RequestError(f"option axes={self._axes}: must be {OPTICAL} or {FORWARD}")
        self.max_gap = options.positive("gap", MAX_GAP)
        self._tree = FrameTree(bag.path)
        self._log = PoseLog()
        self._worlds: set[str] = set()
        self._body = ""
        self.world = ""
        self.facts: dict[str, str] = {}
        self.issues: list[InputIssue] = []

    def add(self, topic: str, recorded: int, message: Any) -> None:
        """Add a message of the topic of poses, or of transforms."""
        if topic != self._topics.pose:
            self._tree.add(message, is_static(topic))
            return
        pose = pose_of(message)
        self._log.add(stamp_of(message) or recorded, pose.position, pose.orientation)
        self._worlds.add(plain(message.header.frame_id))
        if self._bag.types[topic] == ODOMETRY:
            self._body = plain(message.child_frame_id)

    def at(
        self, seconds: NDArray[np.float64], origin: int, frames: Collection[str]
    ) -> NDArray[np.float64]:
        """Poses (N, 4, 4) of the camera at times (N,) since `origin` (ns); NaN where there is none.

        `frames` are those of the images. Raises RequestError if frames are missing or ambiguous.
        """
        camera = self._values.get("frame") or self._only(frames, "images")
        if self._topics.pose == TF:
            poses = self._from_transforms(camera, seconds, origin)
        else:
            poses = self._from_topic(camera, seconds, origin)
        if "axes" not in self._values and "optical" not in camera:
            detail = f"x right, y down, z forward; if x is forward, set axes={FORWARD}"
            place = f"{self._bag.path.name}: frame {camera!r}"
            self.issues.append(InputIssue("axes assumed", place, detail))
        self.facts |= {"camera_frame": camera, "world_frame": self.world, "axes": self._axes}
        return in_optical_axes(poses) if self._axes == FORWARD else poses

    def _from_transforms(
        self, camera: str, seconds: NDArray[np.float64], origin: int
    ) -> NDArray[np.float64]:
        links = self._tree.chain(camera, self._values.get("world"))
        if not self._tree.moves(links):
            raise RequestError(
                f"{self._bag.path}: no transform moves frame {camera!r}; set frame= or pose="
            )
        self.world = links[-1][1]
        self.facts["pose_frame"] = camera
        poses, bad = self._tree.poses(links, seconds, origin, self.max_gap)
        self.issues += bad
        return poses

    def _from_topic(
        self, camera: str, seconds: NDArray[np.float64], origin: int
    ) -> NDArray[np.float64]:
        topic = self._topics.pose
        self.world = self._only(self._worlds, f"poses of {topic}")
        body = self._values.get("body") or self._body or camera
        if "body" not in self._values and not self._body and self._topics.transforms:
            detail = f"taken as those of frame {camera!r}; if they are of another, set body="
            self.issues.append(InputIssue("frame assumed", topic, detail))
        self.facts["pose_frame"] = body
        times, known, bad = self._log.ordered(origin, f"{self._bag.path.name}:{topic}")
        self.issues += bad
        links = [] if body == camera else self._tree.chain(camera, body)
        chained, bad = self._tree.poses(links, seconds, origin, self.max_gap)
        self.issues += bad
        return np.asarray(poses_at(seconds, times, known, self.max_gap) @ chained)

    def _only(self, frames: Collection[str], what: str) -> str:
        if len(frames) > 1:
            names = ", ".join(sorted(frames)[:8])
            advice = "; choose one with frame=" if what == "images" else ""
            raise RequestError(f"{self._bag.path}: {what} are in frames {names}{advice}")
        if not frames:
            raise RequestError(f"{self._bag.path}: {what}: no messages of the declared type")
        return next(iter(frames))
