"""A ROS 1 camera that publishes drawn images; run as `python -m bench.support.ros_camera`.

It prints the stamp of each image, in nanoseconds, and registers again at a restarted master.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rtools.ros.proxy_node import camera_info_topic
from s2rtools.ros.ros1_node import MasterLink, MasterUnreachableError
from s2rtools.ros.ros_environment import ros_module

NAME = "/test_camera"


def draw(index: int, width: int, height: int) -> NDArray[np.uint8]:
    """A smooth image (height, width, 3), with a moving bar so that images differ."""
    rows, columns = np.mgrid[0:height, 0:width]
    planes = [columns * 255 // width, rows * 255 // height, (rows + columns) % 256]
    image = np.stack(planes, axis=-1).astype(np.uint8)
    image[:, (8 * index) % width :][:, :8] = 255
    return image


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--topic", required=True)
    parser.add_argument("--rate", type=float, default=30.0, help="images per second")
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--damage-every", type=int, default=0, help="cut off every nth image")
    options = parser.parse_args()
    width, height = (int(edge) for edge in options.size.split("x"))
    rospy, messages = ros_module("rospy"), ros_module("sensor_msgs.msg")
    rospy.init_node(NAME.strip("/"), argv=["camera"])
    compressed = options.topic.endswith("/compressed")
    kind = messages.CompressedImage if compressed else messages.Image
    images = rospy.Publisher(options.topic, kind, queue_size=1, tcp_nodelay=True)
    info_topic = camera_info_topic(options.topic)
    infos = rospy.Publisher(info_topic, messages.CameraInfo, queue_size=1)
    drawn = [_message(kind, draw(index, width, height)) for index in range(16)]
    link = MasterLink(os.environ["ROS_MASTER_URI"], NAME)
    due, index = time.monotonic(), 0
    while not rospy.is_shutdown():
        message = drawn[index % len(drawn)]
        message.header.stamp, message.header.frame_id = rospy.Time.now(), "camera_optical"
        damaged = options.damage_every and index % options.damage_every == 0
        sent = message
        if damaged:
            sent = kind(header=message.header, data=message.data[: len(message.data) // 2])
        else:
            print(message.header.stamp.to_nsec(), flush=True)
        images.publish(sent)
        infos.publish(messages.CameraInfo(header=message.header, width=width, height=height))
        index += 1
        if index % 10 == 0:
            _stay_registered(link, rospy.get_node_uri())
        due += 1 / options.rate
        time.sleep(max(0.0, due - time.monotonic()))
    return 0


def _message(kind: Any, image: NDArray[np.uint8]) -> Any:
    if not hasattr(kind, "encoding"):
        content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 85])[1]
        return kind(format="rgb8; jpeg compressed bgr8", data=content.tobytes())
    height, width = image.shape[:2]
    return kind(height=height, width=width, encoding="bgr8", step=3 * width, data=image.tobytes())


def _stay_registered(link: MasterLink, uri: str) -> None:
    try:
        if link.node_uri() is None:
            link.register_again(uri)
    except MasterUnreachableError:
        pass


if __name__ == "__main__":
    sys.exit(main())
