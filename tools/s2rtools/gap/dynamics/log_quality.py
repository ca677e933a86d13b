"""Checks that the logs of a drive are good enough for the dynamics axis."""

from __future__ import annotations

import numpy as np

from s2rstore.errors import InconclusiveError, RequestError
from s2rtools.gap.dynamics import ape_rpe
from s2rtools.gap.dynamics.noise_floor import Noise
from s2rtools.motion_logs.motion_log import Drive, Log

MIN_STEPS = 4
"""Smallest number of steps between poses in a window of the shortest horizon."""
MIN_TRAVEL = 1e-3
"""Smallest distance in the shortest horizon of a robot that moves, m."""
MIN_TRAVEL_OVER_NOISE = 3.0
"""Smallest ratio of the travel in that time to the noise of the poses."""
MAX_MOTION = 0.01
"""Largest share of that travel in the part of the noise estimate that may be motion."""
MAX_SPEED_RATIO = 20.0
"""Largest ratio of real and simulated speed that suggests equal units."""


def require_sampling(log: Log, horizon: float) -> None:
    """Raises InconclusiveError where poses are too far apart for windows of `horizon` s."""
    step = float(np.median(np.diff(log.time)))
    longest = horizon / MIN_STEPS
    if step > longest * (1 + 1e-6):
        raise InconclusiveError(
            f"{log.source}: poses every {step:.3g} s are too coarse for windows of "
            f"{horizon:g} s; record one every {longest:.3g} s or more often, or use horizons from "
            f"{MIN_STEPS * step:.3g} s on (--dynamics horizons=...)"
        )


def require_motion(real: Log, horizon: float, measured: Noise) -> None:
    """Raises InconclusiveError where the robot stays in place, or moves less than the noise."""
    covered = ape_rpe.travel(real, horizon)
    if covered < max(MIN_TRAVEL, MIN_TRAVEL_OVER_NOISE * measured.position):
        raise InconclusiveError(
            f"{real.source}: the robot only turns or stands ({covered:.2g} m in "
            f"{horizon:g} s, noise {measured.position:.2g} m); leave this drive out"
        )
    if measured.motion > max(MAX_MOTION * covered, 0.5 * measured.position):
        raise InconclusiveError(
            f"{real.source}: noise cannot be separated from motion ({measured.motion:.2g} m may be "
            "either); record poses more often, or declare their noise (--dynamics noise=...)"
        )


def log_warnings(drive: Drive) -> tuple[str, ...]:
    """Sentences about what may be wrong with the logs of a drive."""
    real, sim = (ape_rpe.travel(log, 1.0) for log in (drive.real, drive.sim))
    if sim * MAX_SPEED_RATIO >= real and real * MAX_SPEED_RATIO >= sim:
        return drive.warnings
    warning = (
        f"drive {drive.name}: the real robot drives {real:.3g} m per second, the simulated one "
        f"{sim:.3g} m; are both logs in metres and seconds?"
    )
    return (*drive.warnings, warning)


def untuned_log(drive: Drive, axis: str) -> Log:
    """Raises RequestError where the drive has no untuned log."""
    if drive.odometry is not None:
        raise RequestError(
            f"{axis}: drive {drive.name} compares odometry with its ground truth; odometry has no "
            "untuned simulator as the bad state, so the axis can be measured but not frozen"
        )
    if drive.untuned is None:
        raise RequestError(
            f"{axis}: drive {drive.name} has no untuned.*, the declared bad state; record one"
        )
    return drive.untuned
