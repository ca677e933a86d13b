"""The proxy as a node of ROS 2 (rclpy)."""

from __future__ import annotations

import array
import threading
from contextlib import suppress
from typing import Any

from s2rtools.ros.image_topics import (
    camera_info_topic,
    check_topics,
    fill_translated,
    frame_of,
    is_compressed,
)
from s2rtools.ros.proxy_core import Frame, ProxyCore
from s2rtools.ros.proxy_settings import ProxyRequest
from s2rtools.ros.ros_environment import ros_module

_DIAGNOSTICS_SECONDS = 1.0


def run(request: ProxyRequest) -> None:
    """Run the node until it is interrupted."""
    rclpy = ros_module("rclpy")
    signals = ros_module("rclpy.signals").SignalHandlerOptions.ALL
    rclpy.init(args=list(request.arguments), signal_handler_options=signals)
    node = rclpy.create_node(request.node_name)
    proxy = Ros2Proxy(request, node)
    ended = (KeyboardInterrupt, ros_module("rclpy.executors").ExternalShutdownException)
    try:
        with suppress(*ended):
            rclpy.spin(node)
    finally:
        proxy.stop()
        node.destroy_node()
        rclpy.try_shutdown()


class Ros2Proxy:
    """Publishers, subscriptions, parameters and the worker of a node."""

    def __init__(self, request: ProxyRequest, node: Any) -> None:
        self._request, self._node = request, node
        self._input = node.resolve_topic_name(request.input_topic)
        self._output = node.resolve_topic_name(request.output_topic)
        check_topics(self._input, self._output)
        self._core = ProxyCore(
            request.settings, self._ros_time, self._publish, self._publish_latency
        )
        self._diagnostic_messages = ros_module("diagnostic_msgs.msg")
        self._number = ros_module("std_msgs.msg").Float32
        for name, value in request.settings.parameters().items():
            node.declare_parameter(name, value)
        node.add_on_set_parameters_callback(self._set_parameters)
        self._subscribe()
        self._stop = threading.Event()
        self._worker = threading.Thread(
            target=self._core.work, args=(self._stop,), name="translate"
        )
        self._worker.start()

    def stop(self) -> None:
        """End the worker."""
        self._stop.set()
        self._core.close()
        self._worker.join()

    def _subscribe(self) -> None:
        node, qos, messages = self._node, ros_module("rclpy.qos"), ros_module("sensor_msgs.msg")
        # A best-effort subscription hears every publisher, a reliable publisher serves every
        # subscription.
        newest = qos.QoSProfile(
            depth=1, history=qos.HistoryPolicy.KEEP_LAST,
            reliability=qos.ReliabilityPolicy.BEST_EFFORT,
        )  # fmt: skip
        known = dict(node.get_topic_names_and_types()).get(self._input)
        compressed = is_compressed(self._input, known[0] if known else None)
        self._type = messages.CompressedImage if compressed else messages.Image
        self._images = node.create_publisher(self._type, self._output, 1)
        self._latency = node.create_publisher(self._number, "~/latency", 10)
        self._diagnostics = node.create_publisher(
            self._diagnostic_messages.DiagnosticArray, "/diagnostics", 10
        )
        info, new_info = camera_info_topic(self._input), camera_info_topic(self._output)
        if info != new_info:
            infos = node.create_publisher(messages.CameraInfo, new_info, 10)
            node.create_subscription(messages.CameraInfo, info, infos.publish, newest)
        node.create_subscription(self._type, self._input, self._receive, newest)
        node.create_timer(_DIAGNOSTICS_SECONDS, self._publish_diagnostics)

    def _ros_time(self) -> float:
        return float(self._node.get_clock().now().nanoseconds) * 1e-9

    def _receive(self, message: Any) -> None:
        stamp = message.header.stamp
        self._core.offer(frame_of(message, stamp.sec + 1e-9 * stamp.nanosec))

    def _publish(self, frame: Frame, content: bytes | None) -> None:
        message = frame.message
        if content is not None:
            message = fill_translated(self._type(), message, array.array("B", content))
        self._images.publish(message)

    def _publish_latency(self, seconds: float) -> None:
        self._latency.publish(self._number(data=1e3 * seconds))

    def _set_parameters(self, parameters: Any) -> Any:
        result = ros_module("rcl_interfaces.msg").SetParametersResult
        changed = {parameter.name: parameter.value for parameter in parameters}
        error = self._core.change(changed, self._request.load)
        return result(successful=not error, reason=error)

    def _publish_diagnostics(self) -> None:
        messages = self._diagnostic_messages
        status = self._core.status()
        entry = messages.DiagnosticStatus(
            level=messages.DiagnosticStatus.WARN if status.problem
            else messages.DiagnosticStatus.OK,
            name=f"{self._node.get_name()}: translation", hardware_id=self._input,
            message=status.problem or "translating",
            values=[messages.KeyValue(key=key, value=value) for key, value in status.rows],
        )  # fmt: skip
        message = messages.DiagnosticArray(status=[entry])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._diagnostics.publish(message)
