"""Bags of a walk."""

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tests.datasets.layouts.rooms import HEIGHT, WIDTH, Walk
from tests.support.bag_file import BagFile

FORMATS = ("one.bag", "folder", "folder-mcap")
CAMERA = "camera_optical_frame"
RGB, DEPTH, INFO = "/cam/rgb/image_raw", "/cam/depth/image_raw", "/cam/rgb/camera_info"
K = [20.0, 0.0, 11.5, 0.0, 21.0, 7.5, 0.0, 0.0, 1.0]


class CameraBag(BagFile):
    """A bag with the images of a camera and its CameraInfo."""

    camera = CAMERA

    def __init__(self, path: Path) -> None:
        super().__init__(path, latency=7_000_000)

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
        self.add(topic, kind, time + self.latency, self.make(kind, **fields))


Message = Callable[[CameraBag, int, int], object]
"""Adds messages of a time, ns, and a row to a bag."""


def nanoseconds(scene: Walk) -> list[int]:
    return [round(time * 10) * 10**8 for time in scene.times]


def png(pixels: np.ndarray) -> bytes:
    return cv2.imencode(".png", pixels[..., ::-1] if pixels.ndim == 3 else pixels)[1].tobytes()


def compressed_depth(pixels: np.ndarray, a: float = 0.0, b: float = 0.0) -> bytes:
    return struct.pack("<iff", int(a != 0), a, b) + png(pixels)


def walk_bag(path: Path, scene: Walk, **messages: Message | None) -> CameraBag:
    """A bag with RGB, depth, CameraInfo and a pose of the camera for each row of a walk.

    `messages` replace what adds those of a row: `rgb`, `depth`, `info` or `pose`; None adds none.
    """
    usual: dict[str, Message | None] = {
        "rgb": lambda bag, time, row: bag.image(RGB, time, scene.rgb[row], "rgb8"),
        "depth": lambda bag, time, row: bag.image(
            DEPTH, time + 3_000_000, scene.depth[row], "16UC1"
        ),
        "info": lambda bag, time, row: bag.info(INFO, time),
        "pose": lambda bag, time, row: bag.pose("/pose", time, scene.poses[row]),
    }
    bag = CameraBag(path)
    for row, time in enumerate(nanoseconds(scene)):
        for add in (usual | messages).values():
            if add is not None:
                add(bag, time, row)
    return bag
