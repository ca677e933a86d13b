"""What drives must show, and have, before they say anything."""

from __future__ import annotations

import numpy as np

from s2rstore.errors import InconclusiveError, RequestError
from s2rtools.gap.dynamics import pose_errors
from s2rtools.gap.dynamics.noise_floor import Noise
from s2rtools.motion_logs.motion_log import Drive, Log

MIN_STEPS = 4
"""Steps between poses that a window of the shortest horizon must span."""
MIN_TRAVEL = 1e-3
"""m in the shortest horizon, below which a robot stands."""
CLEAR = 3.0
"""Times the noise that it must travel in that time."""
MAX_MOTION = 0.01
"""Share of that travel in what may be noise as well as motion, where it is no small part of it."""

UNLIKE = 20.0
"""Times as fast, from which on one log is hardly of the same drive in the same units."""


def demand_fine(log: Log, horizon: float) -> None:
    """Raises InconclusiveError where poses are too far apart for windows of `horizon` s."""
    step = float(np.median(np.diff(log.time)))
    longest = horizon / MIN_STEPS
    if step > longest * (1 + 1e-6):
        raise InconclusiveError(
            f"{log.source}: poses every {step:.3g} s are too coarse for windows of "
            f"{horizon:g} s; record one every {longest:.3g} s or oftener, or ask for horizons from "
            f"{MIN_STEPS * step:.3g} s on (--dynamics horizons=...)"
        )


def demand_motion(real: Log, horizon: float, measured: Noise) -> None:
    """Raises InconclusiveError where a robot goes nowhere, or its motion looks like noise."""
    covered = pose_errors.travel(real, horizon)
    if covered < max(MIN_TRAVEL, CLEAR * measured.position):
        raise InconclusiveError(
            f"{real.source}: the robot turns or stands ({covered:.2g} m in "
            f"{horizon:g} s, noise {measured.position:.2g} m); leave this drive out"
        )
    if measured.motion > max(MAX_MOTION * covered, 0.5 * measured.position):
        raise InconclusiveError(
            f"{real.source}: noise cannot be told from motion ({measured.motion:.2g} m "
            "may be either); record poses oftener, or declare their noise (--dynamics noise=...)"
        )


def doubts(drive: Drive) -> tuple[str, ...]:
    """What may be wrong with a drive's logs, as sentences."""
    real, sim = (pose_errors.travel(log, 1.0) for log in (drive.real, drive.sim))
    if sim * UNLIKE >= real and real * UNLIKE >= sim:
        return drive.doubts
    told = (
        f"drive {drive.name}: the real robot drives {real:.3g} m in a second, the simulated one "
        f"{sim:.3g} m; are both logs in metres and seconds?"
    )
    return (*drive.doubts, told)


def untuned_of(drive: Drive, axis: str) -> Log:
    """Raises RequestError where the drive has no untuned log."""
    if drive.odometry is not None:
        raise RequestError(
            f"{axis}: drive {drive.name} compares odometry with its ground truth; odometry has no "
            "untuned simulator for a bad state, so it is measured and cannot be frozen"
        )
    if drive.untuned is None:
        raise RequestError(
            f"{axis}: drive {drive.name} has no untuned.*, the declared bad state; record one"
        )
    return drive.untuned
