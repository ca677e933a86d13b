"""The reader of each kind of log, by suffix."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from s2rstore.errors import RequestError
from s2rtools.motion_logs import csv_reader, rosbag_reader, tum_reader
from s2rtools.motion_logs.motion_log import Log

READERS: dict[str, Callable[[Path], Log]] = {
    ".csv": csv_reader.read,
    ".tum": tum_reader.read,
    ".txt": tum_reader.read,
    ".bag": rosbag_reader.read,
    ".db3": rosbag_reader.read,
    ".mcap": rosbag_reader.read,
    "": rosbag_reader.read,
}
"""A name without a suffix is the folder of a ROS 2 bag."""


def read(path: Path, topic: str | None = None) -> Log:
    """A log of any known kind; `topic` names the one of a ROS bag.

    Raises RequestError, one line that names file and line or topic, for whatever is wrong.
    """
    reader = rosbag_reader.read if path.is_dir() else READERS.get(path.suffix.lower())
    if reader is None:
        known = ", ".join(suffix for suffix in READERS if suffix)
        raise RequestError(f"{path}: unknown kind of log (known: {known}, folders of ROS 2)")
    if reader is rosbag_reader.read:
        return rosbag_reader.read(path, topic)
    if topic is not None:
        raise RequestError(f"{path}: has no topics; leave out {topic}")
    return reader(path)
