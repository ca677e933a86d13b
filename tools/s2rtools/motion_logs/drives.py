"""Folders of drives: each subfolder holds the logs of one command sequence.

    DRIVES/NAME/real.*       the robot
    DRIVES/NAME/sim.*        the simulator under the same commands
    DRIVES/NAME/untuned.*    the simulator before any identification (optional)
    DRIVES/NAME/commands.csv the commands (optional)

`READERS` lists the suffixes. All files of a drive use one clock.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from s2rstore.errors import RequestError
from s2rtools.motion_logs import csv_reader, pose_readers
from s2rtools.motion_logs.motion_log import Drive, Log


def read_drives(folder: Path, topic: str | None = None) -> tuple[Drive, ...]:
    """All drives, sorted by name; `topic` carries the poses in ROS bags.

    Raises RequestError where the folder holds no drive, or a drive lacks a readable real or sim
    log.
    """
    if not folder.is_dir():
        raise RequestError(f"{folder}: no such folder of drives")
    folders = sorted(p for p in folder.iterdir() if p.is_dir() and not p.name.startswith("."))
    if not folders:
        raise RequestError(f"{folder}: no drive in it (folders with real.* and sim.*)")
    return tuple(_read_drive(path, topic) for path in folders)


def _read_drive(folder: Path, topic: str | None) -> Drive:
    logs: dict[str, Log] = {}
    for role in ("real", "sim", "untuned"):
        path = _log_path(folder, role)
        if path is not None:
            bag = path.is_dir() or path.suffix.lower() in (".bag", ".db3", ".mcap")
            logs[role] = read(path, topic if bag else None)
        elif role != "untuned":
            raise RequestError(f"{folder}: no {role}.* in it; a drive needs real.* and sim.*")
    path = folder / "commands.csv"
    commands = csv_reader.read_commands(path) if path.exists() else None
    return Drive(folder.name, logs["real"], logs["sim"], logs.get("untuned"), commands)


def _log_path(folder: Path, role: str) -> Path | None:
    """The only log of a role; files of other kinds (images, notes) do not count."""
    paths = sorted(
        path
        for path in folder.iterdir()
        if path.stem == role
        and path.suffix.lower() in READERS
        and (path.suffix or (path / "metadata.yaml").is_file())
    )
    if len(paths) > 1:
        names = ", ".join(path.name for path in paths)
        raise RequestError(f"{folder}: {names}; only one {role} log is allowed")
    return paths[0] if paths else None


READERS: dict[str, Callable[[Path], Log]] = {
    ".csv": csv_reader.read,
    ".tum": pose_readers.read_tum,
    ".txt": pose_readers.read_tum,
    ".bag": pose_readers.read_bag,
    ".db3": pose_readers.read_bag,
    ".mcap": pose_readers.read_bag,
    "": pose_readers.read_bag,
}
"""Readers by suffix; a name without a suffix is the folder of a ROS 2 bag."""


def read(path: Path, topic: str | None = None) -> Log:
    """A log in any known format; `topic` selects the topic of a ROS bag.

    Raises RequestError that names the file and the line or topic.
    """
    reader = pose_readers.read_bag if path.is_dir() else READERS.get(path.suffix.lower())
    if reader is None:
        known = ", ".join(suffix for suffix in READERS if suffix)
        raise RequestError(f"{path}: unknown log format (known: {known}, ROS 2 bag folders)")
    if reader is pose_readers.read_bag:
        return pose_readers.read_bag(path, topic)
    if topic is not None:
        raise RequestError(f"{path}: has no topics; leave out {topic}")
    return reader(path)
