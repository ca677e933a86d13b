"""Write ROS 1 and ROS 2 bags message by message with `rosbags`."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation


class BagFile:
    """Builds messages of ROS 1 or ROS 2 types, and writes them in the order in which they came.

    It is a ROS 1 bag if the name ends in ".bag", else a ROS 2 folder ("mcap" selects MCAP).
    Messages are recorded `latency` nanoseconds after the stamps of their headers.
    """

    camera = "camera"
    """Frame of the images."""

    def __init__(self, path: Path, latency: int) -> None:
        self.path, self.ros1, self.latency = path, path.suffix == ".bag", latency
        self.topics: dict[str, str] = {}
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
        self.topics[topic] = kind
        self.items.append((topic, kind, recorded, message))

    def image(
        self, topic: str, time: int, pixels: np.ndarray, encoding: str, frame: str = "",
        padding: int = 0, **changes: Any,
    ) -> None:  # fmt: skip
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
        rows = np.pad(rows, ((0, 0), (0, padding)))
        kind = "sensor_msgs/msg/Image"
        fields = {
            "header": self.header(time, frame or self.camera), "height": pixels.shape[0],
            "width": pixels.shape[1], "encoding": encoding, "is_bigendian": 0,
            "step": rows.shape[1], "data": rows.ravel(),
        } | changes  # fmt: skip
        self.add(topic, kind, time + self.latency, self.make(kind, **fields))

    def compressed(self, topic: str, time: int, content: bytes, form: str, frame: str = "") -> None:
        kind = "sensor_msgs/msg/CompressedImage"
        data = np.frombuffer(content, np.uint8)
        message = self.make(
            kind, header=self.header(time, frame or self.camera), format=form, data=data
        )
        self.add(topic, kind, time + self.latency, message)

    def _pose(self, pose: np.ndarray) -> Any:
        position = self.make("geometry_msgs/msg/Point", **_axes(pose[:3, 3]))
        return self.make(
            "geometry_msgs/msg/Pose", position=position, orientation=self._rotation(pose)
        )

    def _rotation(self, pose: np.ndarray) -> Any:
        x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def pose(self, topic: str, time: int, pose: np.ndarray, frame: str = "map") -> None:
        kind = "geometry_msgs/msg/PoseStamped"
        message = self.make(kind, header=self.header(time, frame), pose=self._pose(pose))
        self.add(topic, kind, time + self.latency, message)

    def covariant_pose(self, topic: str, time: int, pose: np.ndarray) -> None:
        kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
        inner = self.make(
            "geometry_msgs/msg/PoseWithCovariance", pose=self._pose(pose), covariance=np.zeros(36)
        )
        message = self.make(kind, header=self.header(time, "map"), pose=inner)
        self.add(topic, kind, time + self.latency, message)

    def odometry(self, topic: str, time: int, pose: np.ndarray, child: str) -> None:
        zero = self.make("geometry_msgs/msg/Vector3", **_axes([0.0] * 3))
        twist = self.make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        kind = "nav_msgs/msg/Odometry"
        message = self.make(
            kind, header=self.header(time, "odom"), child_frame_id=child,
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=self._pose(pose),
                           covariance=np.zeros(36)),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist,
                            covariance=np.zeros(36)),
        )  # fmt: skip
        self.add(topic, kind, time + self.latency, message)

    def transform(self, topic: str, time: int, parent: str, child: str, pose: np.ndarray) -> None:
        translation = self.make("geometry_msgs/msg/Vector3", **_axes(pose[:3, 3]))
        inner = self.make(
            "geometry_msgs/msg/Transform", translation=translation, rotation=self._rotation(pose)
        )
        stamped = self.make(
            "geometry_msgs/msg/TransformStamped", header=self.header(time, parent),
            child_frame_id=child, transform=inner,
        )  # fmt: skip
        kind = "tf2_msgs/msg/TFMessage"
        self.add(topic, kind, time + self.latency, self.make(kind, transforms=[stamped]))

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
            connections = {
                topic: bag.add_connection(topic, kind, typestore=self.store)
                for topic, kind in self.topics.items()
            }
            for topic, kind, recorded, message in self.items:
                bag.write(connections[topic], recorded, serialize(message, kind))
        return self.path


def _axes(values: Iterable[float]) -> dict[str, float]:
    return dict(zip("xyz", map(float, values), strict=True))
