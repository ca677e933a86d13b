"""Messages of a ROS bag, in one pass or one by one in any order."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Collection, Generator, Iterator, Mapping
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.security.memory_limit import bounded_memory
from s2rtools.common.bag_files import LARGEST_UNPACKED, READING_MEMORY, check_bag, refusing_damage

ODOMETRY = "nav_msgs/msg/Odometry"
POSES = (
    ODOMETRY,
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
)
"""Types of messages that hold a pose."""
_Key = tuple[str, int, int]
"""Topic, recording time and stamp."""
_RECENT_BYTES = 32 << 20
"""Messages that are kept because threads request them in another order."""
_AHEAD = 500_000_000
"""Nanoseconds to a message that is reached by reading those in front of it."""


class BagMessages:
    """The messages of a ROS 1 bag, a ROS 2 folder, or a `.db3` or `.mcap` file.

    The bag stays open as long as this object lives. A message is found by the time at which it was
    recorded, through the index of the bag; an MCAP file without one is read from its start unless
    messages are requested in their order.
    """

    def __init__(self, path: Path) -> None:
        """Open a bag. Raises RequestError if it is missing or damaged."""
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        check_bag(path)
        self.path = path
        self._lock = threading.Lock()
        self._recent: dict[_Key, Any] = {}
        self._recent_bytes = 0
        self._requested: set[str] = set()
        self._cursor: Iterator[tuple[Any, int, bytes]] | None = None
        self._position = 0
        stack = ExitStack()
        weakref.finalize(self, _close, stack)
        with refusing_damage(path), bounded_memory(READING_MEMORY, LARGEST_UNPACKED):
            store = get_typestore(Stores.ROS2_HUMBLE)
            self._reader = stack.enter_context(AnyReader([path], default_typestore=store))
            connections = [each for each in self._reader.connections if each.msgcount]
        self._connections: dict[str, list[Any]] = {}
        for each in connections:
            self._connections.setdefault(each.topic, []).append(each)
        self.types = {topic: each[0].msgtype for topic, each in self._connections.items()}
        """Message type of each topic that has messages."""
        self.repeated = {
            topic: sorted({each.msgtype for each in listed})
            for topic, listed in self._connections.items()
            if len({each.msgtype for each in listed}) > 1
        }
        """The types of each topic that is listed with several."""

    def all_of(self, topics: Collection[str]) -> Generator[tuple[str, int, Any], None, None]:
        """Topic, recording time (ns) and message of all messages on `topics`, by recording time.

        Raises RequestError where the bag is damaged.
        """
        chosen = [each for topic in topics for each in self._connections[topic]]
        if not chosen:
            return
        with (
            refusing_damage(self.path),
            self._lock,
            bounded_memory(READING_MEMORY, LARGEST_UNPACKED),
        ):
            for connection, time, raw in self._reader.messages(chosen):
                yield connection.topic, time, self._message(connection, raw)

    def first(self, topic: str) -> Any:
        """The first message of a topic. Raises RequestError where the bag is damaged."""
        with closing(self.all_of((topic,))) as messages:
            for _, _, message in messages:
                return message
        raise RequestError(f"{self.path}: topic {topic} has no messages of its declared type")

    def at(self, topic: str, recorded: int, stamp: int) -> Any:
        """The message of `topic` with a recording time and the stamp of its header, in ns.

        May be called from any thread. In about the order of the bag, each message is read once.
        Raises RequestError if it cannot be read.
        """
        key = topic, recorded, stamp
        with refusing_damage(self.path), self._lock:
            try:
                if key not in self._recent and not self._is_ahead(key):
                    self._start(topic, recorded)
                    self._read_on(key)
                if key in self._recent:
                    return self._recent[key]
            except Exception:
                self._cursor = None
                raise
        raise RequestError(f"{self.path}: topic {topic} has no message at {recorded} any more")

    def _start(self, topic: str, recorded: int) -> None:
        """Continue reading at a time, on all topics of which messages were requested."""
        self._requested.add(topic)
        chosen = [each for name in sorted(self._requested) for each in self._connections[name]]
        self._cursor = self._reader.messages(chosen, start=recorded)
        self._position = recorded

    def _is_ahead(self, key: _Key) -> bool:
        """Whether a message was found by reading on, if it is not far."""
        topic, recorded, _ = key
        if topic not in self._requested or not 0 <= recorded - self._position <= _AHEAD:
            return False
        try:
            return self._read_on(key)
        except Exception:  # perhaps of a damaged message in front of it
            return False

    def _read_on(self, key: _Key) -> bool:
        """Read the messages up to one, and keep the last of them; whether it was found."""
        for connection, position, raw in self._cursor or ():
            self._position = position
            message = self._message(connection, raw)
            found = connection.topic, position, stamp_of(message)
            if found not in self._recent:
                self._recent[found] = message
                self._recent_bytes += len(message.data)
            while self._recent_bytes > _RECENT_BYTES and len(self._recent) > 1:
                self._recent_bytes -= len(self._recent.pop(next(iter(self._recent))).data)
            if found == key:
                return True
            if position > key[1]:
                return False
        self._cursor = None
        return False

    def _message(self, connection: Any, raw: bytes) -> Any:
        return self._reader.deserialize(raw, connection.msgtype)


def _close(stack: ExitStack) -> None:
    with suppress(Exception):  # of a damaged database, whose damage was reported while it was read
        stack.close()


def stamp_of(message: Any) -> int:
    """Nanoseconds of a message's header."""
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def pose_of(message: Any) -> Any:
    """The position and orientation of a message of a type in `POSES`."""
    return getattr(message.pose, "pose", message.pose)


def choose_topic(
    bag: Path,
    types: Mapping[str, str],
    usable_types: Collection[str],
    requested: str | None,
    names: tuple[str, str],
) -> str:
    """The requested topic, or else the only one of a usable type; `types` are those of all topics.

    `names` are what such topics hold, and the option that names one. Raises RequestError where
    there is no such topic, or several.
    """
    content, option = names
    usable = sorted(topic for topic, kind in types.items() if kind in usable_types)
    if requested is not None:
        if requested not in types:
            known = ", ".join(usable) or f"none with {content}"
            raise RequestError(f"{bag}: no topic {requested} (has: {known})")
        if requested not in usable:
            kind = types[requested]
            raise RequestError(f"{bag}: topic {requested} is {kind}, which holds no {content}")
        return requested
    if not usable:
        known = ", ".join(sorted({each.rpartition("/")[2] for each in usable_types}))
        raise RequestError(f"{bag}: no topic with {content} ({known})")
    if len(usable) > 1:
        raise RequestError(
            f"{bag}: several topics have {content}; name one of {', '.join(usable)} ({option})"
        )
    return usable[0]


def frame_name(frame: str) -> str:
    """The name of a frame without the slash that older versions of ROS began it with."""
    return frame.removeprefix("/")
