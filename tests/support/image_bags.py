"""Write ROS bags with an image topic and a topic of strings."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.support.bag_file import BagFile

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
    """Write RGB images, then `damaged` ones, with a text after each of them."""
    bag = BagFile(path, latency=0)
    for index, image in enumerate([*images, *[None] * damaged]):
        time = START + index * STEP
        if kind == COMPRESSED:
            content = b"nothing" if image is None else cv2.imencode(".jpg", image[..., ::-1])[1]
            bag.compressed(IMAGES, time, bytes(content), "jpeg")
        elif image is None:
            empty = {"height": 0, "width": 0, "step": 0, "data": np.zeros(0, dtype=np.uint8)}
            bag.image(IMAGES, time, np.zeros((1, 1, 3), dtype=np.uint8), "rgb8", **empty)
        else:
            bag.image(IMAGES, time, image, "rgb8")
        text = "std_msgs/msg/String"
        bag.add(STRINGS, text, time + 1, bag.make(text, data=f"message {index}"))
    bag.topics |= {IMAGES: kind, STRINGS: "std_msgs/msg/String"}
    return bag.write()
