"""The proxy as a node of ROS 1 (rospy), which registers again after a restart of the master.

A node stays registered only as long as its master runs. `MasterLink` compares what the master knows
with what the node publishes and subscribes to, over the XML-RPC interfaces of master and node.
"""

from __future__ import annotations

import http.client
import signal
import threading
import xmlrpc.client
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any
from xml.parsers import expat

from s2rtools.ros.proxy_core import ProxyCore
from s2rtools.ros.proxy_node import DIAGNOSTICS_SECONDS, ProxyNode, Publish
from s2rtools.ros.proxy_settings import ProxyRequest
from s2rtools.ros.ros_environment import ros_module

TIMEOUT = 5.0
"""Seconds for one call."""
_ERRORS = (OSError, http.client.HTTPException, xmlrpc.client.Error, expat.ExpatError, ValueError,
           TypeError)  # fmt: skip
_SUCCESS = 1
BUFFER_BYTES = 1 << 24
"""Bytes read from a connection at once: several images, so that none waits in the socket."""
_POLL_SECONDS = 0.5
"""Time between looks at the master and its parameters."""


class MasterUnreachableError(ConnectionError):
    """The master, or the node, does not answer."""


class MasterLink:
    """Calls of node `node_name` to the master at `uri`."""

    def __init__(self, uri: str, node_name: str) -> None:
        self.uri, self._name = uri, node_name
        self._services: dict[str, str] = {}

    def is_up(self) -> bool:
        """Whether the master answers."""
        try:
            self._call("getPid")
        except MasterUnreachableError:
            return False
        return True

    def node_uri(self) -> str | None:
        """URI of the node that the master knows by this name. Raises MasterUnreachableError."""
        return self._call("lookupNode", self._name) or None

    def remember_services(self) -> None:
        """Note the services of the node, to register them again. Raises MasterUnreachableError."""
        state: Any = self._call("getSystemState") or ([], [], [])
        for service, providers in state[2]:
            if self._name in providers:
                self._services[service] = self._call("lookupService", service)

    def register_again(self, node_uri: str) -> None:
        """Register all topics and services of the node. Raises MasterUnreachableError."""
        for topic, kind in _call(node_uri, "getPublications", self._name) or []:
            self._call("registerPublisher", topic, kind, node_uri)
        for topic, kind in _call(node_uri, "getSubscriptions", self._name) or []:
            publishers = self._call("registerSubscriber", topic, kind, node_uri)
            _call(node_uri, "publisherUpdate", "/master", topic, publishers or [])
        for service, service_uri in self._services.items():
            self._call("registerService", service, service_uri, node_uri)

    def topic_type(self, topic: str) -> str | None:
        """Type of a topic, such as `sensor_msgs/Image`; None where the master does not know it."""
        return dict(self._call("getTopicTypes") or []).get(topic)

    def parameters(self) -> dict[str, Any]:
        """Private parameters of the node; empty where there are none."""
        found = self._call("getParam", self._name)
        return found if isinstance(found, dict) else {}

    def set_parameters(self, values: dict[str, Any]) -> None:
        """Set private parameters of the node."""
        for name, value in values.items():
            self._call("setParam", f"{self._name}/{name}", value)

    def _call(self, method: str, *arguments: Any) -> Any:
        return _call(self.uri, method, self._name, *arguments)


class _Transport(xmlrpc.client.Transport):
    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = TIMEOUT
        return connection


def _call(uri: str, method: str, *arguments: Any) -> Any:
    """Value of a call, None where the callee reports a failure."""
    try:
        with xmlrpc.client.ServerProxy(uri, transport=_Transport(), allow_none=True) as server:
            status, _, value = getattr(server, method)(*arguments)
    except _ERRORS as error:
        raise MasterUnreachableError(f"{uri}: {error}") from error
    return value if status == _SUCCESS else None


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
            _work(request, rospy, link, stop)
        finally:
            rospy.signal_shutdown("the proxy ends")


def _work(request: ProxyRequest, rospy: Any, link: MasterLink, stop: threading.Event) -> None:
    """Work until `stop` is set or the master replaces this node by another of its name."""
    proxy = ProxyNode(request, _Rospy(rospy, link))
    registration = _Registration(request, proxy.core, link, rospy)
    since_diagnostics = 0.0
    rospy.loginfo("translate %s to %s", proxy.input, proxy.output)
    try:
        registration.begin()
        while not stop.wait(_POLL_SECONDS) and not rospy.is_shutdown():
            registration.check()
            since_diagnostics += _POLL_SECONDS
            if since_diagnostics >= DIAGNOSTICS_SECONDS:
                since_diagnostics = 0.0
                proxy.publish_diagnostics()
    finally:
        proxy.stop()


class _Rospy:
    """`RosClient` of rospy, for an initialised node."""

    private = "~"

    def __init__(self, rospy: Any, link: MasterLink) -> None:
        self._rospy, self._link = rospy, link
        self.name: str = rospy.get_name()

    def resolve(self, topic: str) -> str:
        return str(self._rospy.resolve_name(topic))

    def topic_type(self, topic: str) -> str | None:
        try:
            return self._link.topic_type(topic)
        except MasterUnreachableError:
            return None

    def now(self) -> tuple[float, Any]:
        time = self._rospy.Time.now()
        return float(time.to_sec()), time

    def seconds(self, stamp: Any) -> float:
        return float(stamp.to_sec())

    def data(self, content: bytes) -> bytes:
        return content

    def publisher(self, topic: str, kind: type, queue: int) -> Publish:
        publish: Publish = self._rospy.Publisher(
            topic, kind, queue_size=queue, tcp_nodelay=True
        ).publish
        return publish

    def subscribe(self, topic: str, kind: type, callback: Publish) -> None:
        """Without a queue, so that every frame is received and those replaced are counted."""
        self._rospy.Subscriber(
            topic, kind, callback, queue_size=None, buff_size=BUFFER_BYTES, tcp_nodelay=True
        )

    def forward(self, topic: str, target: str, kind: type) -> None:
        publish = self.publisher(target, kind, 10)

        def republish(message: Any) -> None:
            with suppress(self._rospy.ROSException):  # publishers close before subscribers
                publish(message)

        self._rospy.Subscriber(topic, kind, republish, queue_size=10)


class _Registration:
    """Registration and parameters of the node at the master, renewed after its restart."""

    def __init__(
        self, request: ProxyRequest, core: ProxyCore, link: MasterLink, rospy: Any
    ) -> None:
        self._core, self._link, self._load, self._rospy = core, link, request.load, rospy
        self._uri: str = rospy.get_node_uri()
        self._registered = True
        self._last: dict[str, Any] = {}

    def begin(self) -> None:
        """Write the parameters; a master that is lost meanwhile gets them later."""
        try:
            self._link.remember_services()
            self._write_parameters()
        except MasterUnreachableError:
            self._registered = False

    def check(self) -> None:
        """Register the node again if the master has forgotten it, and follow the parameters.

        A master that knows another node by this name has replaced this one, which then ends.
        """
        try:
            if self._link.node_uri() is None or not self._registered:
                self._registered = False
                self._link.register_again(self._uri)
                self._write_parameters()
                self._registered = True
                self._rospy.logwarn("registered again at the restarted master %s", self._link.uri)
            self._follow_parameters()
        except MasterUnreachableError as error:
            self._rospy.logwarn_throttle(30, "waiting for the master: %s", error)

    def _write_parameters(self) -> None:
        self._link.set_parameters(self._core.settings.parameters())

    def _follow_parameters(self) -> None:
        """Apply private parameters of the node that differ from the settings."""
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
