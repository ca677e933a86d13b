"""Write ROS bags with an image topic and a topic of strings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

COMPRESSED, RAW = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image"
IMAGES, STRINGS = "/camera/image", "/chatter"
START = 1_700_000_000_000_000_000
"""Nanoseconds of the first message; one image follows each 33 ms."""
STEP = 33_000_000


def grey_images(count: int, size: int = 16) -> list[NDArray[np.uint8]]:
    """Grey images (size, size, 3) of level 100."""
    return [np.full((size, size, 3), 100, dtype=np.uint8)] * count


def write_image_bag(
    path: Path, images: Sequence[NDArray[np.uint8]], kind: str = COMPRESSED, damaged: int = 0
) -> Path:
    """Write RGB images, then `damaged` ones: a ROS 1 bag if the name ends in ".bag", else a ROS 2
    folder ("mcap" in the name selects MCAP)."""
    ros1 = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    plugin = StoragePlugin["MCAP" if "mcap" in path.name else "SQLITE3"]
    writer = Writer1(path) if ros1 else Writer2(path, version=9, storage_plugin=plugin)
    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    types = store.types
    with writer as bag:
        topic = bag.add_connection(IMAGES, kind, typestore=store)
        strings = bag.add_connection(STRINGS, "std_msgs/msg/String", typestore=store)
        for index, image in enumerate([*images, *[None] * damaged]):
            time = START + index * STEP
            stamp = types["builtin_interfaces/msg/Time"](sec=time // 10**9, nanosec=time % 10**9)
            extra = {"seq": index} if ros1 else {}
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="camera", **extra)
            message = _message(types[kind], header, image)
            bag.write(topic, time, serialize(message, kind))
            text = types["std_msgs/msg/String"](data=f"message {index}")
            bag.write(strings, time + 1, serialize(text, "std_msgs/msg/String"))
    return path


def _message(kind, header, image):
    if "Compressed" in kind.__name__:
        content = np.frombuffer(b"nothing", dtype=np.uint8) if image is None \
            else cv2.imencode(".jpg", image[..., ::-1])[1].ravel()  # fmt: skip
        return kind(header=header, format="jpeg", data=content)
    height, width = (0, 0) if image is None else image.shape[:2]
    data = np.zeros(0, dtype=np.uint8) if image is None else image.ravel()
    return kind(
        header=header, height=height, width=width, encoding="rgb8", is_bigendian=0, step=3 * width,
        data=data,
    )  # fmt: skip
