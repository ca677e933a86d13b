"""The proxy as a node of ROS 1 (rospy)."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from s2rtools.ros.image_topics import (
    camera_info_topic,
    check_topics,
    fill_translated,
    frame_of,
    is_compressed,
)
from s2rtools.ros.master_link import MasterLink, MasterUnreachableError
from s2rtools.ros.proxy_core import Frame, ProxyCore
from s2rtools.ros.proxy_settings import LoadTranslator, ProxyRequest
from s2rtools.ros.ros_environment import ros_module

BUFFER_BYTES = 1 << 24
"""Bytes read from a connection at once: several images, so that none waits in the socket."""
_POLL_SECONDS = 0.5
"""Time between looks at the master and its parameters."""
_DIAGNOSTICS_SECONDS = 1.0


def run(request: ProxyRequest) -> None:
    """Run the node until SIGINT or SIGTERM; waits for the master first."""
    rosgraph, names = ros_module("rosgraph"), ros_module("rosgraph.names")
    rospy = ros_module("rospy")
    with _stop_on_signals() as stop:
        arguments = ["s2r", *request.arguments]
        name = names.ns_join(
            names.get_ros_namespace(argv=arguments),
            names.load_mappings(arguments).get("__name", request.node_name),
        )
        link = MasterLink(rosgraph.get_master_uri(argv=arguments), name)
        if not _wait_for_master(link, stop):
            return
        rospy.init_node(request.node_name, argv=arguments, disable_signals=True)
        try:
            Ros1Proxy(request, link).run(stop)
        finally:
            rospy.signal_shutdown("the proxy ends")


class Ros1Proxy:
    """Publishers, subscribers and the worker of an initialised node."""

    def __init__(self, request: ProxyRequest, link: MasterLink) -> None:
        self._rospy = rospy = ros_module("rospy")
        self._request, self._link = request, link
        self._uri: str = rospy.get_node_uri()
        self._core = ProxyCore(
            request.settings, rospy.get_time, self._publish, self._publish_latency
        )
        topics = [rospy.resolve_name(t) for t in (request.input_topic, request.output_topic)]
        self._input, self._output = topics
        check_topics(*topics)
        self._parameters = _Parameters(self._core, link, request.load, rospy)
        self._registered = True
        self._subscribe()

    def run(self, stop: threading.Event) -> None:
        """Work until `stop` is set or the master replaces this node by another of its name."""
        worker = threading.Thread(target=self._core.work, args=(stop,), name="translate")
        worker.start()
        since_diagnostics = 0.0
        self._rospy.loginfo("translate %s to %s", self._input, self._output)
        try:
            self._begin()
            while not stop.wait(_POLL_SECONDS) and not self._rospy.is_shutdown():
                self._watch_master()
                since_diagnostics += _POLL_SECONDS
                if since_diagnostics >= _DIAGNOSTICS_SECONDS:
                    since_diagnostics = 0.0
                    self._publish_diagnostics()
        finally:
            stop.set()
            self._core.close()
            worker.join()

    def _begin(self) -> None:
        """Write the parameters; a master that is lost meanwhile gets them later."""
        try:
            self._link.remember_services()
            self._parameters.write()
        except MasterUnreachableError:
            self._registered = False

    def _subscribe(self) -> None:
        rospy, messages = self._rospy, ros_module("sensor_msgs.msg")
        diagnostics, numbers = ros_module("diagnostic_msgs.msg"), ros_module("std_msgs.msg")
        known = None
        with suppress(MasterUnreachableError):
            known = self._link.topic_type(self._input)
        compressed = is_compressed(self._input, known)
        self._type = messages.CompressedImage if compressed else messages.Image
        self._images = rospy.Publisher(self._output, self._type, queue_size=1, tcp_nodelay=True)
        self._latency = rospy.Publisher("~latency", numbers.Float32, queue_size=10)
        self._diagnostics = rospy.Publisher(
            "/diagnostics", diagnostics.DiagnosticArray, queue_size=10
        )
        info, new_info = camera_info_topic(self._input), camera_info_topic(self._output)
        if info != new_info:
            self._info = rospy.Publisher(new_info, messages.CameraInfo, queue_size=10)
            rospy.Subscriber(info, messages.CameraInfo, self._forward_info, queue_size=10)
        # Without a queue every frame reaches the core, which keeps the newest and counts the rest.
        rospy.Subscriber(
            self._input, self._type, self._receive,
            queue_size=None, buff_size=BUFFER_BYTES, tcp_nodelay=True,
        )  # fmt: skip

    def _receive(self, message: Any) -> None:
        self._core.offer(frame_of(message, message.header.stamp.to_sec()))

    def _forward_info(self, message: Any) -> None:
        # At shutdown rospy closes publishers before subscribers.
        with suppress(self._rospy.ROSException):
            self._info.publish(message)

    def _publish(self, frame: Frame, content: bytes | None) -> None:
        message = frame.message
        if content is not None:
            message = fill_translated(self._type(), message, content)
        self._images.publish(message)

    def _publish_latency(self, seconds: float) -> None:
        self._latency.publish(1e3 * seconds)

    def _watch_master(self) -> None:
        """Register the node again if the master has forgotten it, and follow the parameters.

        A master that knows another node by this name has replaced this one, which then ends.
        """
        try:
            if self._link.node_uri() is None or not self._registered:
                self._registered = False
                self._link.register_again(self._uri)
                self._parameters.write()
                self._registered = True
                self._rospy.logwarn("registered again at the restarted master %s", self._link.uri)
            self._parameters.follow()
        except MasterUnreachableError as error:
            self._rospy.logwarn_throttle(30, "waiting for the master: %s", error)

    def _publish_diagnostics(self) -> None:
        diagnostics = ros_module("diagnostic_msgs.msg")
        status, rows = self._core.status(), []
        for name, value in status.rows:
            rows.append(diagnostics.KeyValue(key=name, value=value))
        level = diagnostics.DiagnosticStatus.WARN if status.problem \
            else diagnostics.DiagnosticStatus.OK  # fmt: skip
        entry = diagnostics.DiagnosticStatus(
            level=level, name=f"{self._rospy.get_name()}: translation", hardware_id=self._input,
            message=status.problem or "translating", values=rows,
        )  # fmt: skip
        array = diagnostics.DiagnosticArray(status=[entry])
        array.header.stamp = self._rospy.Time.now()
        self._diagnostics.publish(array)


class _Parameters:
    """The settings as private parameters of the node at the master."""

    def __init__(self, core: ProxyCore, link: MasterLink, load: LoadTranslator, rospy: Any) -> None:
        self._core, self._link, self._load, self._rospy = core, link, load, rospy
        self._last: dict[str, Any] = {}

    def write(self) -> None:
        """Write the settings. Raises MasterUnreachableError."""
        self._link.set_parameters(self._core.settings.parameters())

    def follow(self) -> None:
        """Apply parameters that differ from the settings. Raises MasterUnreachableError."""
        known, present = self._core.settings.parameters(), self._link.parameters()
        changed = {
            name: value for name, value in present.items() if name in known and value != known[name]
        }
        if changed == self._last:
            return
        self._last = changed
        error = self._core.change(changed, self._load)
        if error:
            self._rospy.logerr(error)
        elif changed:
            self._rospy.loginfo("changed %s", ", ".join(sorted(changed)))


def _wait_for_master(link: MasterLink, stop: threading.Event) -> bool:
    """Wait until the master answers; False if `stop` was set before."""
    told = False
    while not stop.is_set():
        if link.is_up():
            return True
        if not told:
            told = True
            print(f"s2r: waiting for the ROS master at {link.uri}", flush=True)
        stop.wait(_POLL_SECONDS)
    return False


@contextmanager
def _stop_on_signals() -> Iterator[threading.Event]:
    """An event that SIGINT and SIGTERM set."""
    stop = threading.Event()
    kinds = (signal.SIGINT, signal.SIGTERM)
    before = {kind: signal.signal(kind, lambda *ignored: stop.set()) for kind in kinds}
    try:
        yield stop
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)
