"""A small stand-in for rclpy: one process, callbacks called by the test."""

import array
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest


@dataclass
class Stamp:
    sec: int = 0
    nanosec: int = 0


@dataclass
class Header:
    stamp: Stamp = field(default_factory=Stamp)
    frame_id: str = ""


@dataclass
class CompressedImage:
    header: Header = field(default_factory=Header)
    format: str = ""
    data: array.array = field(default_factory=lambda: array.array("B"))


@dataclass
class Image:
    header: Header = field(default_factory=Header)
    height: int = 0
    width: int = 0
    encoding: str = ""
    is_bigendian: int = 0
    step: int = 0
    data: array.array = field(default_factory=lambda: array.array("B"))


@dataclass
class CameraInfo:
    header: Header = field(default_factory=Header)


@dataclass
class Float32:
    data: float = 0.0


@dataclass
class KeyValue:
    key: str = ""
    value: str = ""


@dataclass
class DiagnosticStatus:
    OK = b"\x00"
    WARN = b"\x01"
    level: bytes = OK
    name: str = ""
    message: str = ""
    hardware_id: str = ""
    values: list[KeyValue] = field(default_factory=list)


@dataclass
class DiagnosticArray:
    header: Header = field(default_factory=Header)
    status: list[DiagnosticStatus] = field(default_factory=list)


@dataclass
class SetParametersResult:
    successful: bool = True
    reason: str = ""


class Publisher:
    def __init__(self) -> None:
        self.messages: list[Any] = []

    def publish(self, message: Any) -> None:
        self.messages.append(message)


class Node:
    """Publishers and callbacks by topic; `seconds` is the time of its clock."""

    def __init__(self, known: dict[str, str], seconds: int) -> None:
        self.publishers: dict[str, Publisher] = {}
        self.callbacks: dict[str, Callable[[Any], None]] = {}
        self.types: dict[str, type] = {}
        self.timers: list[Callable[[], None]] = []
        self.parameters: dict[str, Any] = {}
        self.set_parameters: Callable[[list[Any]], SetParametersResult]
        self._known, self._seconds = known, seconds

    def get_name(self) -> str:
        return "translation_proxy"

    def resolve_topic_name(self, topic: str) -> str:
        return topic if topic.startswith("/") else f"/{topic}"

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        return [(topic, [kind]) for topic, kind in self._known.items()]

    def create_publisher(self, kind: type, topic: str, depth: int) -> Publisher:
        self.types[topic] = kind
        return self.publishers.setdefault(topic, Publisher())

    def create_subscription(self, kind: type, topic: str, callback: Any, qos: Any) -> None:
        self.types[topic] = kind
        self.callbacks[topic] = callback

    def create_timer(self, seconds: float, callback: Callable[[], None]) -> None:
        self.timers.append(callback)

    def declare_parameter(self, name: str, value: Any) -> None:
        self.parameters[name] = value

    def add_on_set_parameters_callback(self, callback: Any) -> None:
        self.set_parameters = callback

    def get_clock(self) -> Any:
        now = SimpleNamespace(
            nanoseconds=self._seconds * 10**9, to_msg=lambda: Stamp(self._seconds)
        )
        return SimpleNamespace(now=lambda: now)


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Put the modules that the node imports into `sys.modules`."""
    modules: dict[str, dict[str, Any]] = {
        "rclpy": {},
        "rclpy.qos": {
            "QoSProfile": SimpleNamespace,
            "HistoryPolicy": SimpleNamespace(KEEP_LAST=1),
            "ReliabilityPolicy": SimpleNamespace(BEST_EFFORT=2),
        },
        "sensor_msgs": {},
        "sensor_msgs.msg": {
            "CompressedImage": CompressedImage, "Image": Image, "CameraInfo": CameraInfo,
        },
        "std_msgs": {},
        "std_msgs.msg": {"Float32": Float32},
        "diagnostic_msgs": {},
        "diagnostic_msgs.msg": {
            "DiagnosticArray": DiagnosticArray, "DiagnosticStatus": DiagnosticStatus,
            "KeyValue": KeyValue,
        },
        "rcl_interfaces": {},
        "rcl_interfaces.msg": {"SetParametersResult": SetParametersResult},
    }  # fmt: skip
    for name, content in modules.items():
        module = ModuleType(name)
        module.__dict__.update(content)
        monkeypatch.setitem(sys.modules, name, module)
