"""The reader of each kind of log, by suffix."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from s2rstore.errors import RequestError
from s2rtools.logs import csvlog, rosbag, tum
from s2rtools.logs.contract import Log

READERS: dict[str, Callable[[Path], Log]] = {
    ".csv": csvlog.read,
    ".tum": tum.read,
    ".txt": tum.read,
    ".bag": rosbag.read,
    ".db3": rosbag.read,
    ".mcap": rosbag.read,
    "": rosbag.read,
}
"""A name without a suffix is the folder of a ROS 2 bag."""


def read(path: Path, topic: str | None = None) -> Log:
    """A log of any known kind; `topic` names the one of a ROS bag.

    Raises RequestError, one line that names file and line or topic, for whatever is wrong.
    """
    reader = rosbag.read if path.is_dir() else READERS.get(path.suffix.lower())
    if reader is None:
        known = ", ".join(suffix for suffix in READERS if suffix)
        raise RequestError(f"{path}: unknown kind of log (known: {known}, folders of ROS 2)")
    if reader is rosbag.read:
        return rosbag.read(path, topic)
    if topic is not None:
        raise RequestError(f"{path}: has no topics; leave out {topic}")
    return reader(path)
