"""Write ROS 1 and ROS 2 bags of a walk with `rosbags`."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from tests.datasets.layouts.rooms import HEIGHT, WIDTH, Walk

FORMATS = ("one.bag", "folder", "folder-mcap")
CAMERA = "camera_optical_frame"
RGB, DEPTH, INFO = "/cam/rgb/image_raw", "/cam/depth/image_raw", "/cam/rgb/camera_info"
K = [20.0, 0.0, 11.5, 0.0, 21.0, 7.5, 0.0, 0.0, 1.0]
LATENCY = 7_000_000
"""Nanoseconds from a header's stamp to the recording."""


@dataclass
class Item:
    topic: str
    kind: str
    time: int
    fields: dict[str, Any]


class BagFile:
    """Builds messages of ROS 1 or ROS 2 types, and writes them in the order in which they came."""

    def __init__(self, path: Path) -> None:
        self.path, self.ros1 = path, path.suffix == ".bag"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.ros1 else Stores.ROS2_HUMBLE)
        if self.ros1:
            text = "geometry_msgs/TransformStamped[] transforms\n"
            self.store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))
        self.items: list[tuple[str, str, int, Any]] = []

    def make(self, kind: str, **fields: Any) -> Any:
        return self.store.types[kind](**fields)

    def header(self, time: int, frame: str) -> Any:
        stamp = self.make("builtin_interfaces/msg/Time", sec=time // 10**9, nanosec=time % 10**9)
        extra = {"seq": 0} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **extra)

    def add(self, topic: str, kind: str, recorded: int, message: Any) -> None:
        self.items.append((topic, kind, recorded, message))

    def image(
        self, topic: str, time: int, pixels: np.ndarray, encoding: str, frame: str = CAMERA,
        padding: int = 0, **changes: Any,
    ) -> None:  # fmt: skip
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
        rows = np.pad(rows, ((0, 0), (0, padding)))
        kind = "sensor_msgs/msg/Image"
        fields = {
            "header": self.header(time, frame), "height": pixels.shape[0],
            "width": pixels.shape[1], "encoding": encoding, "is_bigendian": 0,
            "step": rows.shape[1], "data": rows.ravel(),
        } | changes  # fmt: skip
        self.add(topic, kind, time + LATENCY, self.make(kind, **fields))

    def compressed(
        self, topic: str, time: int, content: bytes, form: str, frame: str = CAMERA
    ) -> None:
        kind = "sensor_msgs/msg/CompressedImage"
        data = np.frombuffer(content, np.uint8)
        message = self.make(kind, header=self.header(time, frame), format=form, data=data)
        self.add(topic, kind, time + LATENCY, message)

    def info(self, topic: str, time: int, **changes: Any) -> None:
        kind = "sensor_msgs/msg/CameraInfo"
        names = "DKRP" if self.ros1 else "dkrp"
        p = [18.0, 0.0, 10.5, 0.0, 0.0, 19.0, 6.5, 0.0, 0.0, 0.0, 1.0, 0.0]
        values = {"d": [0.0] * 5, "k": K, "r": np.eye(3).ravel(), "p": p}
        values |= {key: changes.pop(key) for key in tuple(changes) if key in values}
        arrays = {name: np.array(values[name.lower()], dtype=np.float64) for name in names}
        roi = self.make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0,
            do_rectify=False,
        )  # fmt: skip
        fields = {
            "header": self.header(time, CAMERA), "height": HEIGHT, "width": WIDTH,
            "distortion_model": "plumb_bob", "binning_x": 0, "binning_y": 0, "roi": roi,
        } | arrays | changes  # fmt: skip
        self.add(topic, kind, time + LATENCY, self.make(kind, **fields))

    def _pose(self, pose: np.ndarray) -> Any:
        position = self.make("geometry_msgs/msg/Point", **axes(pose[:3, 3]))
        return self.make(
            "geometry_msgs/msg/Pose", position=position, orientation=self._rotation(pose)
        )

    def _rotation(self, pose: np.ndarray) -> Any:
        x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def pose(self, topic: str, time: int, pose: np.ndarray, frame: str = "map") -> None:
        kind = "geometry_msgs/msg/PoseStamped"
        message = self.make(kind, header=self.header(time, frame), pose=self._pose(pose))
        self.add(topic, kind, time + LATENCY, message)

    def covariant_pose(self, topic: str, time: int, pose: np.ndarray) -> None:
        kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
        inner = self.make(
            "geometry_msgs/msg/PoseWithCovariance", pose=self._pose(pose), covariance=np.zeros(36)
        )
        message = self.make(kind, header=self.header(time, "map"), pose=inner)
        self.add(topic, kind, time + LATENCY, message)

    def odometry(self, topic: str, time: int, pose: np.ndarray, child: str) -> None:
        zero = self.make("geometry_msgs/msg/Vector3", **axes([0.0] * 3))
        twist = self.make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        kind = "nav_msgs/msg/Odometry"
        message = self.make(
            kind, header=self.header(time, "odom"), child_frame_id=child,
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=self._pose(pose),
                           covariance=np.zeros(36)),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist,
                            covariance=np.zeros(36)),
        )  # fmt: skip
        self.add(topic, kind, time + LATENCY, message)

    def transform(self, topic: str, time: int, parent: str, child: str, pose: np.ndarray) -> None:
        translation = self.make("geometry_msgs/msg/Vector3", **axes(pose[:3, 3]))
        inner = self.make(
            "geometry_msgs/msg/Transform", translation=translation, rotation=self._rotation(pose)
        )
        stamped = self.make(
            "geometry_msgs/msg/TransformStamped", header=self.header(time, parent),
            child_frame_id=child, transform=inner,
        )  # fmt: skip
        kind = "tf2_msgs/msg/TFMessage"
        self.add(topic, kind, time + LATENCY, self.make(kind, transforms=[stamped]))

    def write(self, compression: str = "") -> Path:
        """`compression` is FILE, MESSAGE or STORAGE for ROS 2, BZ2 or LZ4 for ROS 1."""
        if self.ros1:
            writer: Any = Writer1(self.path)
        else:
            plugin = StoragePlugin["MCAP" if "mcap" in self.path.name else "SQLITE3"]
            writer = Writer2(self.path, version=9, storage_plugin=plugin)
        if compression and self.ros1:
            writer.set_compression(Writer1.CompressionFormat[compression])
        elif compression:
            writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
        serialize = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
        with writer as bag:
            connections: dict[str, Any] = {}
            for topic, kind, recorded, message in self.items:
                if topic not in connections:
                    connections[topic] = bag.add_connection(topic, kind, typestore=self.store)
                bag.write(connections[topic], recorded, serialize(message, kind))
        return self.path


def axes(values: Iterable[float]) -> dict[str, float]:
    return dict(zip("xyz", map(float, values), strict=True))


def nanoseconds(scene: Walk) -> list[int]:
    return [round(time * 10) * 10**8 for time in scene.times]


def png(pixels: np.ndarray) -> bytes:
    return cv2.imencode(".png", pixels[..., ::-1] if pixels.ndim == 3 else pixels)[1].tobytes()


def compressed_depth(pixels: np.ndarray, a: float = 0.0, b: float = 0.0) -> bytes:
    return struct.pack("<iff", int(a != 0), a, b) + png(pixels)


def walk_bag(path: Path, scene: Walk, pose: str = "pose") -> BagFile:
    """A bag with raw RGB and 16-bit depth, CameraInfo, and poses of the camera."""
    bag = BagFile(path)
    for row, time in enumerate(nanoseconds(scene)):
        bag.image(RGB, time, scene.rgb[row], "rgb8")
        bag.image(DEPTH, time + 3_000_000, scene.depth[row], "16UC1")
        bag.info(INFO, time)
        if pose == "pose":
            bag.pose("/pose", time, scene.poses[row])
    return bag
