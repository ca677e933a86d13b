"""A folder of drives: each folder in it holds what was recorded of one command sequence.

    DRIVES/NAME/real.*       the robot
    DRIVES/NAME/sim.*        the simulator, given the same commands
    DRIVES/NAME/untuned.*    the simulator before any identification; may be missing
    DRIVES/NAME/commands.csv what both were told; may be missing

Suffixes are those of `READERS`; all clocks of one drive are the same clock.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from s2rstore.errors import RequestError
from s2rtools.motion_logs import csv_reader, rosbag_reader, tum_reader
from s2rtools.motion_logs.motion_log import Drive, Log


def read_drives(folder: Path, topic: str | None = None) -> tuple[Drive, ...]:
    """By name. `topic` is that of all ROS bags among them.

    Raises RequestError where the folder holds no drive, or a drive no readable real and sim log.
    """
    if not folder.is_dir():
        raise RequestError(f"{folder}: no such folder of drives")
    inside = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    names = [path for path in inside if path.is_dir()]
    if not names:
        raise RequestError(f"{folder}: no drive in it (folders with real.* and sim.*)")
    return tuple(read_drive(path, topic) for path in names)


def read_drive(folder: Path, topic: str | None = None) -> Drive:
    """One drive, named as its folder."""
    logs: dict[str, Log] = {}
    for role in ("real", "sim", "untuned"):
        path = _only(folder, role)
        if path is not None:
            bag = path.is_dir() or path.suffix.lower() in (".bag", ".db3", ".mcap")
            logs[role] = read(path, topic if bag else None)
        elif role != "untuned":
            raise RequestError(f"{folder}: no {role}.* in it; a drive needs real.* and sim.*")
    told = folder / "commands.csv"
    commands = csv_reader.read_commands(told) if told.exists() else None
    return Drive(folder.name, logs["real"], logs["sim"], logs.get("untuned"), commands)


def _only(folder: Path, role: str) -> Path | None:
    """The one log of a role; files of other kinds (pictures, notes) do not count."""
    found = sorted(
        path
        for path in folder.iterdir()
        if path.stem == role
        and path.suffix.lower() in READERS
        and (path.suffix or (path / "metadata.yaml").is_file())
    )
    if len(found) > 1:
        raise RequestError(
            f"{folder}: {', '.join(path.name for path in found)}; keep one {role} log"
        )
    return found[0] if found else None


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
