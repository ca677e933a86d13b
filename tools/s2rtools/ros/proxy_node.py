"""The proxy as a node: its topics, messages and worker, the same for ROS 1 and ROS 2."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Protocol

from s2rstore.errors import RequestError
from s2rtools.ros.proxy_core import Frame, ProxyCore
from s2rtools.ros.proxy_settings import ProxyRequest
from s2rtools.ros.ros_environment import ros_module
from s2rtools.translation.image_codec import RawLayout

COMPRESSED_SUFFIX = "/compressed"
DIAGNOSTICS_SECONDS = 1.0
_QUEUE = 10
"""Messages that wait for a slow subscriber, except for images, of which the newest waits."""
Publish = Callable[[Any], None]


class RosClient(Protocol):
    """What differs between the client libraries of ROS 1 and ROS 2."""

    name: str
    """Name of the node."""
    private: str
    """Prefix of the names of the node's own topics."""

    def resolve(self, topic: str) -> str:
        """The full name of a topic, after remapping."""

    def topic_type(self, topic: str) -> str | None:
        """Type of a topic, such as `sensor_msgs/Image`; None where it is not known."""

    def now(self) -> tuple[float, Any]:
        """The time in seconds, and as the stamp of a header."""

    def seconds(self, stamp: Any) -> float:
        """The seconds of the stamp of a header."""

    def data(self, content: bytes) -> Any:
        """Bytes as the data of an image message."""

    def publisher(self, topic: str, kind: type, queue: int) -> Publish:
        """A function that publishes messages of a type."""

    def subscribe(self, topic: str, kind: type, callback: Publish) -> None:
        """Call a function with every image of a topic, or the newest where it is slower."""

    def forward(self, topic: str, target: str, kind: type) -> None:
        """Publish the messages of a topic unchanged to another."""


class ProxyNode:
    """Publishers, subscriptions and the worker; `core` translates."""

    def __init__(self, request: ProxyRequest, ros: RosClient) -> None:
        self._ros = ros
        self.input, self.output = (
            ros.resolve(request.input_topic),
            ros.resolve(request.output_topic),
        )
        check_topics(self.input, self.output)
        self.core = ProxyCore(
            request.settings, lambda: ros.now()[0], self._publish, self._publish_latency
        )
        messages = ros_module("sensor_msgs.msg")
        self._diagnostic_messages = ros_module("diagnostic_msgs.msg")
        self._number = ros_module("std_msgs.msg").Float32
        compressed = is_compressed(self.input, ros.topic_type(self.input))
        self._type = messages.CompressedImage if compressed else messages.Image
        self._images = ros.publisher(self.output, self._type, 1)
        self._latency = ros.publisher(f"{ros.private}latency", self._number, _QUEUE)
        self._diagnostics = ros.publisher(
            "/diagnostics", self._diagnostic_messages.DiagnosticArray, _QUEUE
        )
        info, new_info = camera_info_topic(self.input), camera_info_topic(self.output)
        if info != new_info:
            ros.forward(info, new_info, messages.CameraInfo)
        ros.subscribe(self.input, self._type, self._receive)
        self._stop = threading.Event()
        self._worker = threading.Thread(target=self.core.work, args=(self._stop,), name="translate")
        self._worker.start()

    def stop(self) -> None:
        """End the worker."""
        self._stop.set()
        self.core.close()
        self._worker.join()

    def publish_diagnostics(self) -> None:
        """Publish the state of the proxy."""
        messages, status = self._diagnostic_messages, self.core.status()
        level = messages.DiagnosticStatus.WARN if status.problem else messages.DiagnosticStatus.OK
        entry = messages.DiagnosticStatus(
            level=level, name=f"{self._ros.name}: translation", hardware_id=self.input,
            message=status.problem or "translating",
            values=[messages.KeyValue(key=key, value=value) for key, value in status.rows],
        )  # fmt: skip
        array = messages.DiagnosticArray(status=[entry])
        array.header.stamp = self._ros.now()[1]
        self._diagnostics(array)

    def _receive(self, message: Any) -> None:
        self.core.offer(frame_of(message, self._ros.seconds(message.header.stamp)))

    def _publish(self, frame: Frame, content: bytes | None) -> None:
        message = frame.message
        if content is not None:
            message = fill_translated(self._type(), message, self._ros.data(content))
        self._images(message)

    def _publish_latency(self, seconds: float) -> None:
        self._latency(self._number(data=1e3 * seconds))


def is_compressed(topic: str, known_type: str | None) -> bool:
    """Whether a topic carries compressed images: by its type if known, else by its name."""
    if known_type is not None:
        return known_type.endswith("/CompressedImage")
    return topic.endswith(COMPRESSED_SUFFIX)


def camera_info_topic(image_topic: str) -> str:
    """Topic of the CameraInfo beside an image topic: `/camera/image_raw/compressed` and
    `/camera/image_raw` have `/camera/camera_info`."""
    base = image_topic.removesuffix(COMPRESSED_SUFFIX)
    return f"{base.rpartition('/')[0]}/camera_info"


def check_topics(input_topic: str, output_topic: str) -> None:
    """Raise RequestError if the output is the input, or only one of them is named compressed."""
    if input_topic == output_topic:
        raise RequestError(f"--out {output_topic}: is the input; give another topic")
    compressed = [topic.endswith(COMPRESSED_SUFFIX) for topic in (input_topic, output_topic)]
    if compressed[0] != compressed[1]:
        advice = "must end" if compressed[0] else "must not end"
        raise RequestError(
            f"--out {output_topic}: {advice} in {COMPRESSED_SUFFIX}, as --in does; "
            "the output has the type of the input"
        )


def frame_of(message: Any, stamp: float) -> Frame:
    """The frame of an Image or CompressedImage message."""
    content = bytes(message.data)
    if not hasattr(message, "step"):
        return Frame(content, stamp, message)
    layout = RawLayout(message.encoding, message.height, message.width, message.step)
    return Frame(content, stamp, message, layout)


def fill_translated(message: Any, original: Any, content: Any) -> Any:
    """Fill an empty message with the header and the format of `original` and other content."""
    message.header = original.header
    fields = ("height", "width", "encoding", "is_bigendian", "step") \
        if hasattr(original, "step") else ("format",)  # fmt: skip
    for name in fields:
        setattr(message, name, getattr(original, name))
    message.data = content
    return message
