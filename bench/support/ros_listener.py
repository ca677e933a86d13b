"""A ROS 1 node that prints what the proxy publishes, one JSON object per line.

Run as `python -m bench.support.ros_listener --topic TOPIC --node NAME`. The lines are
{"image": stamp in ns, "frame_id", "format", "mean": mean colour, "delay": seconds since the stamp},
{"info": stamp}, {"latency": ms} and {"diagnostics": {name: value}, "message"}.
"""

from __future__ import annotations

import argparse
import json
import sys
import threading
from typing import Any

from s2rtools.ros.proxy_node import camera_info_topic, frame_of
from s2rtools.ros.ros_environment import ros_module
from s2rtools.translation.image_codec import UndecodableImageError, decode_compressed, decode_raw

_printing = threading.Lock()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--topic", required=True)
    parser.add_argument("--node", default="/translation_proxy")
    parser.add_argument("--decode", action="store_true", help="print mean colours, too")
    options = parser.parse_args()
    rospy, messages = ros_module("rospy"), ros_module("sensor_msgs.msg")
    rospy.init_node("test_listener", argv=["listener"], anonymous=True)
    compressed = options.topic.endswith("/compressed")

    def image(message: Any) -> None:
        delay = (rospy.Time.now() - message.header.stamp).to_sec()
        row = {"image": message.header.stamp.to_nsec(), "frame_id": message.header.frame_id,
               "format": message.format if compressed else message.encoding,
               "delay": delay}  # fmt: skip
        if options.decode:
            frame = frame_of(message, 0)
            try:
                rgb, _ = decode_raw(frame.content, frame.layout) if frame.layout \
                    else decode_compressed(frame.content)  # fmt: skip
            except UndecodableImageError:
                return
            row["mean"] = rgb.mean(axis=(0, 1)).tolist()
        _print(row)

    def info(message: Any) -> None:
        _print({"info": message.header.stamp.to_nsec()})

    def latency(message: Any) -> None:
        _print({"latency": message.data})

    def diagnostics(message: Any) -> None:
        for status in message.status:
            if status.name.startswith(options.node):
                rows = {each.key: each.value for each in status.values}
                _print({"diagnostics": rows, "message": status.message})

    kind = messages.CompressedImage if compressed else messages.Image
    rospy.Subscriber(options.topic, kind, image, buff_size=1 << 24, tcp_nodelay=True)
    rospy.Subscriber(camera_info_topic(options.topic), messages.CameraInfo, info)
    numbers, arrays = ros_module("std_msgs.msg"), ros_module("diagnostic_msgs.msg")
    rospy.Subscriber(f"{options.node}/latency", numbers.Float32, latency)
    rospy.Subscriber("/diagnostics", arrays.DiagnosticArray, diagnostics)
    _print({"ready": True})
    rospy.spin()
    return 0


def _print(row: dict[str, Any]) -> None:
    with _printing:
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    sys.exit(main())
