"""Poses of a bag's camera, from a topic of poses or from transforms that join coordinate frames."""

from __future__ import annotations

from array import array
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.common.bag_messages import ODOMETRY, BagMessages, frame_name, pose_of, stamp_of
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.bags.topics import TF, Topics, is_static
from s2rtools.datasets.recording import ReadOptions
from s2rtools.datasets.recordings.recorded_poses import (
    in_optical_axes,
    poses_at,
    poses_from_quaternions,
    usable_poses,
)

_MOST_POSES = 4_000_000
"""Poses that are held at once, 80 bytes each; 50 Hz for six links and four hours."""
_SAME = 1e-6
"""Difference of elements of a pose (metres, 1) below which it is repeated without change."""
OPTICAL, FORWARD = "optical", "forward"
"""Values of the option `axes`."""
MAX_GAP = 0.2
"""Seconds between poses that are interpolated, by default."""


@dataclass(slots=True)
class PoseLog:
    """Poses of one frame in another, in the order of the bag; times are nanoseconds."""

    times: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))

    def add(self, time: int, position: Any, rotation: Any) -> None:
        self.times.append(time)
        self.values.extend(
            (position.x, position.y, position.z, rotation.x, rotation.y, rotation.z, rotation.w)
        )

    def ordered(
        self, origin: int, name: str
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], list[InputIssue]]:
        """Sort the poses by time: times (K,), seconds since `origin` (ns), poses (K, 4, 4), issues.

        Unusable poses, and those with the time of another, are left out. `name` names the log in
        the issues.
        """
        issues = []
        stamps = np.frombuffer(self.times, dtype=np.int64)
        values = np.frombuffer(self.values).reshape(-1, 7)
        poses = poses_from_quaternions(values[:, :3], values[:, 3:])
        good = usable_poses(poses)
        if not good.all():
            bad = np.flatnonzero(~good)
            detail = (
                f"{len(bad)} of {len(good)}, first at {stamps[bad[0]]} ns: "
                "not finite, or a quaternion that is not normalised"
            )
            issues.append(InputIssue("bad pose", name, detail))
        stamps, poses = stamps[good], poses[good]
        late = int((np.diff(stamps) < 0).sum())
        if late:
            detail = f"{late} of {len(stamps)} before the one in front of them; sorted"
            issues.append(InputIssue("unordered stamps", name, detail))
        stamps, first, row = np.unique(stamps, return_index=True, return_inverse=True)
        apart = np.abs(poses - poses[first][row]).max(axis=(1, 2)) > _SAME
        if apart.any():
            detail = f"{int(apart.sum())} of {len(poses)} with the stamp of another are left out"
            issues.append(InputIssue("repeated stamps", name, detail))
        return (stamps - origin).astype(np.float64) * 1e-9, poses[first], issues


class FrameTree:
    """Transforms between frames, by child and parent; a static one holds at all times."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._moving: dict[str, dict[str, PoseLog]] = {}
        self._static: dict[str, dict[str, PoseLog]] = {}
        self._count = 0

    def add(self, message: Any, is_static: bool) -> None:
        """Add the transforms of a TFMessage. Raises RequestError for too many."""
        links = self._static if is_static else self._moving
        for each in message.transforms:
            stamp, transform = each.header.stamp, each.transform
            parents = links.setdefault(frame_name(each.child_frame_id), {})
            log = parents.setdefault(frame_name(each.header.frame_id), PoseLog())
            time = int(stamp.sec) * 10**9 + int(stamp.nanosec)
            log.add(time, transform.translation, transform.rotation)
            self._count += 1
            if self._count > _MOST_POSES:
                raise RequestError(f"{self._path}: more than {_MOST_POSES:,} poses; split the bag")

    def chain(self, frame: str, end: str | None) -> list[tuple[str, str]]:
        """(child, parent) of the links from a frame up to `end`, by default to the root.

        Raises RequestError if the frames are not joined, or a frame has several parents.
        """
        links: list[tuple[str, str]] = []
        at = frame
        while at != end:
            parents = sorted({*self._moving.get(at, {}), *self._static.get(at, {})})
            if len(parents) > 1:
                names = ", ".join(map(repr, parents))
                raise RequestError(f"{self._path}: frame {at!r} has several parents: {names}")
            if not parents:
                break
            links.append((at, parents[0]))
            at = parents[0]
            if any(at == child for child, _ in links):
                raise RequestError(f"{self._path}: the parents of frame {at!r} form a circle")
        if end is not None and at != end:
            known = sorted({*self._moving, *self._static} | {parent for _, parent in links})
            names = ", ".join(known[:12]) or "none"
            raise RequestError(
                f"{self._path}: no transforms from frame {frame!r} up to {end!r} (has: {names}); "
                "set frame=, body= or world="
            )
        return links

    def moves(self, links: list[tuple[str, str]]) -> bool:
        """Whether a link of a chain is not static."""
        return any(parent not in self._static.get(child, {}) for child, parent in links)

    def poses(
        self,
        links: list[tuple[str, str]],
        times: NDArray[np.float64],
        origin: int,
        max_gap: float,
    ) -> tuple[NDArray[np.float64], list[InputIssue]]:
        """Poses (N, 4, 4) along a chain at `times` (N,), seconds since `origin`; NaN for none.

        Moving transforms are interpolated by `poses_at`.
        """
        result = np.tile(np.eye(4), (len(times), 1, 1))
        issues: list[InputIssue] = []
        for child, parent in links:
            name = f"{self._path.name}:{parent}->{child}"
            static = self._static.get(child, {}).get(parent)
            log = static or self._moving[child][parent]
            known, poses, bad = log.ordered(origin, name)
            issues += bad
            if static is not None and len(poses):
                if np.abs(poses - poses[-1]).max() > _SAME:
                    issues.append(InputIssue("changing static transform", name, "the last is used"))
                result = poses[-1] @ result
            else:
                result = poses_at(times, known, poses, max_gap) @ result
        return result, issues


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
        self._worlds.add(frame_name(message.header.frame_id))
        if self._bag.types[topic] == ODOMETRY:
            self._body = frame_name(message.child_frame_id)

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
