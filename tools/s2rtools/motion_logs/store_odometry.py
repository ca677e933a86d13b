"""Drives from a store's own odometry: it stands for the simulator, the ground truth for reality."""

from __future__ import annotations

import hashlib

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rtools.motion_logs import rigid_alignment
from s2rtools.motion_logs.motion_log import Drive, Floats, Log
from s2rtools.motion_logs.row_checks import Place, check_pace


def odometry(store: Store, rate: float | None = None, aligned: bool = True) -> tuple[Drive, ...]:
    """One drive per trajectory that has odometry throughout.

    Times are the recorded ones, or seq / `rate` (Hz) where the rate is declared. The frame of
    odometry is its own, and may be mirrored: `aligned` moves it onto the ground truth by the best
    rigid motion or reflection. Raises RequestError where a trajectory has no times, or none has
    odometry.
    """
    truth = store.instances
    drives = []
    for code, name in enumerate(truth.trajectory_names):
        at = np.flatnonzero(truth.trajectory == code)
        where = f"{store.path}: trajectory {name}"
        ox, oy, turned = (c[at] for c in (truth.odom_x, truth.odom_y, truth.odom_heading))
        if at.size < 2 or not np.isfinite(ox + oy + turned).all():
            continue
        time = _time(truth.timestamp[at], truth.seq[at].astype(np.float64), rate, where)
        check_pace(time, _pose_of(where))
        real = _log(time, truth.x[at], truth.y[at], truth.heading[at], f"{where}, ground truth")
        sim = _log(time, ox, oy, turned, f"{where}, odometry")
        moved = rigid_alignment.RigidTransform()
        if aligned:
            moved = rigid_alignment.fit((sim.x, sim.y), (real.x, real.y), reflection=True)
        drives.append(Drive(name, real, moved(sim), odometry=moved))
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
