"""Run the proxy as a node of the ROS version that is installed."""

from __future__ import annotations

import sys

import cv2

from s2rtools.ros.proxy_settings import ProxyRequest


def run_proxy(request: ProxyRequest, version: int) -> None:
    """Run the node of ROS `version` until it is interrupted, with one thread per computation."""
    cv2.setNumThreads(1)
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)
    if version == 1:
        from s2rtools.ros import ros1_node

        ros1_node.run(request)
    else:
        from s2rtools.ros import ros2_node

        ros2_node.run(request)
