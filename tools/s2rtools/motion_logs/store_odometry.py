"""Drives from the odometry of a store: odometry is the simulated log, ground truth the real one."""

from __future__ import annotations

import hashlib

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rtools.motion_logs.motion_log import Drive, Floats, Log, RigidTransform, fit_transform
from s2rtools.motion_logs.row_checks import Place, check_pace


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
