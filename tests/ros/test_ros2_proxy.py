"""The node of ROS 2, on a stand-in for rclpy."""

import array
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import numpy as np
import pytest

from s2rstore.errors import RequestError
from s2rtools.ros import ros2_node
from s2rtools.ros.proxy_node import ProxyNode
from s2rtools.ros.proxy_settings import ProxyRequest, ProxySettings
from tests.ros.conftest import shifted, wait_until
from tests.support import fake_rclpy as ros2

NOW = 1000
Start = Callable[..., ros2.Node]


def load(name: str):
    raise RequestError(f"{name}: no such file")


@pytest.fixture
def start(monkeypatch: pytest.MonkeyPatch) -> Iterator[Start]:
    """A function that starts a proxy and returns its node."""
    ros2.install(monkeypatch)
    started: list[ProxyNode] = []

    def begin(topic: str, output: str, known: dict[str, str] | None = None, **settings: object):
        node = ros2.Node(known or {}, NOW)
        request = ProxyRequest(topic, output, ProxySettings("T", shifted(40), **settings), load)
        started.append(ros2_node.start(request, node))
        return node

    yield begin
    for proxy in started:
        proxy.stop()


def image(seconds: int = NOW) -> ros2.Image:
    header = ros2.Header(ros2.Stamp(seconds, 5), "camera")
    return ros2.Image(header, 2, 2, "rgb8", 0, 6, array.array("B", [100] * 12))


def status(node: ros2.Node) -> dict[str, str]:
    node.timers[0]()
    latest = node.publishers["/diagnostics"].messages[-1].status[0]
    return {each.key: each.value for each in latest.values} | {"message": latest.message}


def test_images_are_translated_and_keep_header_and_layout(start):
    node = start("/camera/image_raw", "/translated/image_raw")
    node.callbacks["/camera/image_raw"](image())
    results = node.publishers["/translated/image_raw"].messages
    wait_until(lambda: results, "an image")
    assert isinstance(results[0].data, array.array)
    assert results[0].data.tolist() == [140, 100, 60] * 4
    assert results[0].header == image().header
    assert (results[0].encoding, results[0].step) == ("rgb8", 6)
    wait_until(lambda: node.publishers["~/latency"].messages, "a latency")
    info = ros2.CameraInfo(image().header)
    node.callbacks["/camera/camera_info"](info)
    assert node.publishers["/translated/camera_info"].messages == [info]


def test_the_type_is_that_of_the_publishers(start):
    node = start("/frames", "/out", {"/frames": "sensor_msgs/msg/CompressedImage"})
    assert node.types["/frames"] is node.types["/out"] is ros2.CompressedImage


def test_parameters_are_declared_changed_and_refused(start):
    node = start("/camera/image_raw", "/translated/image_raw")
    assert node.parameters["strength"] == 1.0
    accepted = node.set_parameters([SimpleNamespace(name="strength", value=0.5)])
    assert accepted.successful
    refused = node.set_parameters([SimpleNamespace(name="strength", value=5.0)])
    assert not refused.successful
    assert "strength" in refused.reason
    assert status(node)["setting strength"] == "0.5"
    node.callbacks["/camera/image_raw"](image())
    results = node.publishers["/translated/image_raw"].messages
    wait_until(lambda: results, "an image")
    assert np.array(results[0].data).reshape(4, 3)[0].tolist() == [120, 100, 80]
