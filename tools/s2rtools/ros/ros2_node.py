"""The proxy as a node of ROS 2 (rclpy)."""

from __future__ import annotations

import array
from contextlib import suppress
from typing import Any

from s2rtools.ros.proxy_node import DIAGNOSTICS_SECONDS, ProxyNode, Publish
from s2rtools.ros.proxy_settings import ProxyRequest
from s2rtools.ros.ros_environment import ros_module


def run(request: ProxyRequest) -> None:
    """Run the node until it is interrupted."""
    rclpy = ros_module("rclpy")
    signals = ros_module("rclpy.signals").SignalHandlerOptions.ALL
    rclpy.init(args=list(request.arguments), signal_handler_options=signals)
    node = rclpy.create_node(request.node_name)
    proxy = start(request, node)
    ended = (KeyboardInterrupt, ros_module("rclpy.executors").ExternalShutdownException)
    try:
        with suppress(*ended):
            rclpy.spin(node)
    finally:
        proxy.stop()
        node.destroy_node()
        rclpy.try_shutdown()


def start(request: ProxyRequest, node: Any) -> ProxyNode:
    """Start the proxy on a node, with the settings as parameters of the node."""
    for name, value in request.settings.parameters().items():
        node.declare_parameter(name, value)
    proxy = ProxyNode(request, _Rclpy(node))
    result = ros_module("rcl_interfaces.msg").SetParametersResult

    def set_parameters(parameters: Any) -> Any:
        changed = {parameter.name: parameter.value for parameter in parameters}
        error = proxy.core.change(changed, request.load)
        return result(successful=not error, reason=error)

    node.add_on_set_parameters_callback(set_parameters)
    node.create_timer(DIAGNOSTICS_SECONDS, proxy.publish_diagnostics)
    return proxy


class _Rclpy:
    """`RosClient` of rclpy.

    A best-effort subscription hears every publisher, a reliable publisher serves every
    subscription.
    """

    private = "~/"

    def __init__(self, node: Any) -> None:
        self._node = node
        self.name: str = node.get_name()
        qos = ros_module("rclpy.qos")
        self._newest = qos.QoSProfile(
            depth=1, history=qos.HistoryPolicy.KEEP_LAST,
            reliability=qos.ReliabilityPolicy.BEST_EFFORT,
        )  # fmt: skip

    def resolve(self, topic: str) -> str:
        return str(self._node.resolve_topic_name(topic))

    def topic_type(self, topic: str) -> str | None:
        known = dict(self._node.get_topic_names_and_types()).get(topic)
        return known[0] if known else None

    def now(self) -> tuple[float, Any]:
        time = self._node.get_clock().now()
        return 1e-9 * float(time.nanoseconds), time.to_msg()

    def seconds(self, stamp: Any) -> float:
        return float(stamp.sec + 1e-9 * stamp.nanosec)

    def data(self, content: bytes) -> Any:
        return array.array("B", content)

    def publisher(self, topic: str, kind: type, queue: int) -> Publish:
        publish: Publish = self._node.create_publisher(kind, topic, queue).publish
        return publish

    def subscribe(self, topic: str, kind: type, callback: Publish) -> None:
        self._node.create_subscription(kind, topic, callback, self._newest)

    def forward(self, topic: str, target: str, kind: type) -> None:
        self.subscribe(topic, kind, self.publisher(target, kind, 10))
