"""Connection of a node to the ROS 1 master, which registers the node again after a restart.

A node stays registered only as long as its master runs. This module compares what the master knows
with what the node publishes and subscribes to, over the XML-RPC interfaces of master and node.
"""

from __future__ import annotations

import http.client
import xmlrpc.client
from typing import Any
from xml.parsers import expat

TIMEOUT = 5.0
"""Seconds for one call."""
_ERRORS = (OSError, http.client.HTTPException, xmlrpc.client.Error, expat.ExpatError, ValueError,
           TypeError)  # fmt: skip
_SUCCESS = 1


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
