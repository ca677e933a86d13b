"""Folders of drives: each subfolder holds the logs of one command sequence.

    DRIVES/NAME/real.*       the robot
    DRIVES/NAME/sim.*        the simulator under the same commands
    DRIVES/NAME/untuned.*    the simulator before any identification (optional)
    DRIVES/NAME/commands.csv the commands (optional)

`READERS` lists the suffixes. All files of a drive use one clock.

The odometry of a store can take the place of a simulated log; its ground truth is the real log.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rtools.motion_logs import csv_reader, pose_readers
from s2rtools.motion_logs.motion_log import Drive, Floats, Log, RigidTransform, fit_transform
from s2rtools.motion_logs.row_checks import Place, check_pace

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


def read_drives(folder: Path, topic: str | None = None) -> tuple[Drive, ...]:
    """All drives, sorted by name; `topic` carries the poses in ROS bags.

    Raises RequestError where the folder holds no drive, or a drive lacks a readable real or sim
    log.
    """
    return tuple(read_drive(path, topic) for path in drive_folders(folder))


def drive_folders(folder: Path) -> list[Path]:
    """The folders of the drives in a folder, by name. Raises RequestError where there is none."""
    if not folder.is_dir():
        raise RequestError(f"{folder}: no such folder of drives")
    folders = sorted(p for p in folder.iterdir() if p.is_dir() and not p.name.startswith("."))
    if not folders:
        raise RequestError(f"{folder}: no drive in it (folders with real.* and sim.*)")
    return folders


def read_drive(folder: Path, topic: str | None = None) -> Drive:
    """The drive in a folder. Raises RequestError where it lacks a readable real or sim log."""
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


def odometry(store: Store, rate: float | None = None, aligned: bool = True) -> tuple[Drive, ...]:
    """One drive per trajectory that has odometry throughout.

    Times are the recorded ones, or seq / `rate` (Hz) if a rate is declared. Odometry has another
    frame, which may be mirrored: `aligned` fits it to the ground truth by a rigid motion or
    reflection. Raises RequestError where a trajectory has no times, or none has odometry.
    """
    truth = store.instances
    drives = []
    for code, name in enumerate(truth.trajectory_names):
        at = np.flatnonzero(truth.trajectory == code)
        where = f"{store.path}: trajectory {name}"
        ox, oy, heading = (c[at] for c in (truth.odom_x, truth.odom_y, truth.odom_heading))
        if at.size < 2 or not np.isfinite(ox + oy + heading).all():
            continue
        time = _time(truth.timestamp[at], truth.seq[at].astype(np.float64), rate, where)
        check_pace(time, _pose_of(where))
        real = _log(time, truth.x[at], truth.y[at], truth.heading[at], f"{where}, ground truth")
        sim = _log(time, ox, oy, heading, f"{where}, odometry")
        transform = RigidTransform()
        if aligned:
            transform = fit_transform((sim.x, sim.y), (real.x, real.y), reflection=True)
        drives.append(Drive(name, real, transform(sim), odometry=transform))
    if not drives:
        raise RequestError(f"{store.path}: no trajectory has odometry throughout")
    return tuple(drives)


def _pose_of(where: str) -> Place:
    return lambda i: f"{where}: pose {i + 1}"


def _time(stamps: Floats, seq: Floats, rate: float | None, where: str) -> Floats:
    if rate is not None:
        if not (np.isfinite(rate) and rate > 0):
            raise RequestError(f"rate {rate:g}: give a positive number of poses per second")
        return seq / rate
    if not np.isfinite(stamps).all():
        raise RequestError(f"{where}: no timestamps; declare the rate of its poses")
    late = np.flatnonzero(np.diff(stamps) <= 0)
    if late.size:
        raise RequestError(f"{where}: the clock does not advance at pose {int(late[0]) + 1}")
    return stamps


def _log(time: Floats, x: Floats, y: Floats, heading: Floats, source: str) -> Log:
    content = hashlib.sha256(np.stack([time, x, y, heading]).tobytes()).hexdigest()
    return Log(time, x, y, heading, source, content)
