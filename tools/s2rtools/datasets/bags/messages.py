"""Messages of a ROS bag, in one pass or one by one in any order."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Collection, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.security.memory_limit import bounded_memory
from s2rtools.common.bag_files import LARGEST_UNPACKED, READING_MEMORY, check_bag, unreadable


class BagMessages:
    """The messages of a ROS 1 bag, a ROS 2 folder, or a `.db3` or `.mcap` file.

    The bag stays open as long as this object lives. A message is read by the time at which it was
    recorded, through the index of the bag; only an MCAP file without one is read from its start.
    """

    def __init__(self, path: Path) -> None:
        """Open a bag. Raises RequestError if it is missing or damaged."""
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        check_bag(path)
        self.path = path
        self._lock = threading.Lock()
        stack = ExitStack()
        weakref.finalize(self, stack.close)
        try:
            with bounded_memory(READING_MEMORY, LARGEST_UNPACKED):
                store = get_typestore(Stores.ROS2_HUMBLE)
                self._reader = stack.enter_context(AnyReader([path], default_typestore=store))
                connections = [each for each in self._reader.connections if each.msgcount]
        except Exception as error:  # a damaged bag fails in every layer below the reader
            raise unreadable(path, error) from error
        self._connections: dict[str, list[Any]] = {}
        for each in connections:
            self._connections.setdefault(each.topic, []).append(each)
        self.types = {topic: each[0].msgtype for topic, each in self._connections.items()}
        """Message type of each topic that has messages."""

    def all_of(self, topics: Collection[str]) -> Iterator[tuple[str, int, Any]]:
        """Topic, recording time (ns) and message of all messages on `topics`, by recording time.

        Raises RequestError where the bag is damaged.
        """
        chosen = [each for topic in topics for each in self._connections[topic]]
        if not chosen:
            return
        try:
            with self._lock, bounded_memory(READING_MEMORY, LARGEST_UNPACKED):
                for connection, time, raw in self._reader.messages(chosen):
                    yield connection.topic, time, self._message(connection, raw)
        except RequestError:
            raise
        except Exception as error:
            raise unreadable(self.path, error) from error

    def first(self, topic: str) -> Any:
        """The first message of a topic. Raises RequestError where the bag is damaged."""
        messages = self.all_of((topic,))
        try:
            return next(message for _, _, message in messages)
        except StopIteration:
            raise RequestError(f"{self.path}: topic {topic} has no messages") from None
        finally:
            messages.close()  # type: ignore[attr-defined]

    def at(self, topic: str, recorded: int, stamp: int) -> Any:
        """The message of `topic` with a recording time and the stamp of its header, in ns.

        May be called from any thread. Raises RequestError if it cannot be read.
        """
        chosen = self._connections[topic]
        try:
            with self._lock:
                for connection, _, raw in self._reader.messages(chosen, recorded, recorded + 1):
                    message = self._message(connection, raw)
                    if stamp_of(message) == stamp:
                        return message
        except Exception as error:
            raise unreadable(self.path, error) from error
        raise RequestError(f"{self.path}: topic {topic} has no message at {recorded} any more")

    def _message(self, connection: Any, raw: bytes) -> Any:
        return self._reader.deserialize(raw, connection.msgtype)


def stamp_of(message: Any) -> int:
    """Nanoseconds of a message's header."""
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)
