"""One bag of a recording: its topics, cameras, images and poses."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.lazy_sequence import LazySequence
from s2rtools.common.bag_messages import BagMessages, stamp_of
from s2rtools.datasets.bags.camera_info import camera_of
from s2rtools.datasets.bags.camera_poses import CameraPoses
from s2rtools.datasets.bags.image_messages import ImageIndex
from s2rtools.datasets.bags.topics import choose_topics
from s2rtools.datasets.recording import (
    PinholeCamera,
    ReadOptions,
    RecordedFrame,
    RecordedTrajectory,
    Recording,
)
from s2rtools.datasets.recordings.recorded_poses import mutual_nearest
from s2rtools.datasets.recordings.stamped_lists import report_none_near
from s2rtools.datasets.recordings.stated_cameras import camera_option

SCALE = "depth_scale"
"""Option: metres per unit of depth of 16 bits."""
TOLERANCE = 0.02
"""Seconds from an RGB image to its depth image, by default."""


class BagPart:
    """One bag: its topics, cameras, index of images and poses."""

    def __init__(self, path: Path, options: ReadOptions, recording: Recording) -> None:
        self._options, self._recording = options, recording
        self.bag = BagMessages(path)
        self.topics = choose_topics(self.bag, options)
        self._rgb = ImageIndex(self.bag, self.topics.rgb)
        self._depth = None if self.topics.depth is None else ImageIndex(self.bag, self.topics.depth)
        self._poses = CameraPoses(self.bag, self.topics, options)
        self._infos: dict[str, Any] = {}
        self._changed: set[str] = set()
        self._scan()
        self.camera, self.depth_camera = self._cameras()

    def _scan(self) -> None:
        """Read all messages once."""
        topics = self.topics
        with closing(self.bag.all_of(topics.all)) as messages:
            for topic, recorded, message in messages:
                if topic == topics.rgb:
                    self._rgb.add(recorded, message)
                elif self._depth is not None and topic == topics.depth:
                    self._depth.add(recorded, message)
                elif topic == topics.pose or topic in topics.transforms:
                    self._poses.add(topic, recorded, message)
                else:
                    self._add_info(topic, message)
        for topic in filter(None, (topics.info, topics.depth_info)):
            if topic not in self._infos:
                raise RequestError(
                    f"{self.bag.path}: topic {topic}: no messages of the declared type"
                )
        for index in filter(None, (self._rgb, self._depth)):
            index.finish()
            self._recording.issues += index.issues
        if self._depth is not None and self._depth.in_metres and SCALE in self._options.values:
            raise RequestError(
                f"{self.bag.path}: depth of {self.topics.depth} is in metres; omit {SCALE}"
            )

    def _add_info(self, topic: str, message: Any) -> None:
        if topic not in self._infos:
            self._infos[topic] = message
            return
        first = self._camera_of(topic, self._infos[topic])
        reported = topic in self._changed
        if not reported and self._camera_of(topic, message) != first:
            self._changed.add(topic)
            detail = f"at {stamp_of(message)} ns; the first CameraInfo is used"
            self._recording.report("changing camera", topic, detail)

    def _camera_of(self, topic: str, message: Any) -> PinholeCamera:
        images = self.topics.depth if topic == self.topics.depth_info else self.topics.rgb
        is_rectified = any(part.startswith("image_rect") for part in str(images).split("/"))
        return camera_of(message, f"{self.bag.path}: topic {topic}", is_rectified)

    def _cameras(self) -> tuple[PinholeCamera, PinholeCamera | None]:
        """The cameras of RGB and depth, None where that is the same."""
        info, depth_info = self.topics.info, self.topics.depth_info
        camera = camera_option(self._options, "camera", self._rgb.common_size())
        if camera is None:
            assert info is not None
            camera = self._camera_of(info, self._infos[info])
        self._check_size(self._rgb, camera)
        if self._depth is None:
            return camera, None
        depth_camera = camera
        if depth_info is not None:
            depth_camera = self._camera_of(depth_info, self._infos[depth_info])
        self._check_size(self._depth, depth_camera)
        if self._depth.frames != self._rgb.frames:
            frames = " and ".join(sorted(self._depth.frames | self._rgb.frames))
            detail = f"frames {frames}; the distance between both is not applied"
            self._recording.report("depth of another frame", self._depth.topic, detail)
        return camera, None if depth_camera == camera else depth_camera

    def _check_size(self, index: ImageIndex, camera: PinholeCamera) -> None:
        height, width = index.common_size()
        if (camera.height, camera.width) != (height, width):
            known = f"their camera's {camera.width}x{camera.height}"
            raise RequestError(
                f"{self.bag.path}: images of {index.topic} are {width}x{height}, but {known}; "
                "choose other topics (rgb=, depth=, info=)"
            )

    @property
    def world(self) -> str:
        """The frame of the poses of the trajectory."""
        return self._poses.world

    @property
    def facts(self) -> dict[str, str]:
        """The topics and frames of the trajectory."""
        named = {name: getattr(self.topics, name) or "" for name in ("rgb", "depth", "pose")}
        return named | self._poses.facts

    def trajectory(self) -> RecordedTrajectory:
        """Frames with depth and pose; the others are reported."""
        rows, depth_rows = self._associated()
        origin = int(self._rgb.times[0])
        seconds = (self._rgb.times[rows] - origin).astype(np.float64) * 1e-9
        poses = self._poses.at(seconds, origin, self._rgb.frames)
        self._recording.issues += self._poses.issues
        posed = np.isfinite(poses).all(axis=(1, 2))
        detail = f"none before and behind it that are at most {self._poses.max_gap} s apart"
        for row in rows[~posed].tolist():
            self._recording.report("no pose", self._rgb.name(row), detail)
        rows, depth_rows = rows[posed], depth_rows[posed]
        depth_camera = self.depth_camera or self.camera
        sizes = tuple((each.height, each.width) for each in (self.camera, depth_camera))
        frames = _frames(self._rgb, self._depth, rows, depth_rows, sizes)
        return RecordedTrajectory(
            frames, poses[posed], self._rgb.times[rows].astype(np.float64) * 1e-9
        )

    def _associated(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows of RGB images and of the depth images nearest in time, one to one."""
        count = len(self._rgb.times)
        if self._depth is None:
            return np.arange(count), np.full(count, -1)
        tolerance = self._options.positive("tolerance", TOLERANCE)
        origin = self._rgb.times[0]
        times, depth_times = (
            (index.times - origin).astype(np.float64) * 1e-9 for index in (self._rgb, self._depth)
        )
        partners = mutual_nearest(times, depth_times, tolerance)
        lonely = np.flatnonzero(partners < 0).tolist()
        images = [(self._rgb.name(row), float(times[row])) for row in lonely]
        rule = f"none within {tolerance * 1000:g} ms"
        report_none_near(self._recording, "no depth image", images, depth_times, rule)
        return np.flatnonzero(partners >= 0), partners[partners >= 0]


def _frames(
    rgb: ImageIndex,
    depth: ImageIndex | None,
    rows: NDArray[np.intp],
    depth_rows: NDArray[np.intp],
    sizes: Sequence[tuple[int, int]],
) -> LazySequence[RecordedFrame]:
    """Frames of rows of both indexes, with images of (height, width)."""

    def frame(row: int) -> RecordedFrame:
        image = rgb.image(int(rows[row]), False, sizes[0])
        if depth is None:
            return RecordedFrame(image)
        return RecordedFrame(image, depth.image(int(depth_rows[row]), True, sizes[1]))

    return LazySequence(len(rows), frame)
