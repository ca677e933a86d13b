"""What logs must show before windows of them say anything."""

from __future__ import annotations

import numpy as np

from s2rstore.errors import InconclusiveError
from s2rtools.gap.dynamics import errors, noise
from s2rtools.logs.contract import Log

MIN_STEPS = 4
"""Steps between poses that a window of the shortest horizon must span."""
MIN_TRAVEL = 1e-3
"""m in the shortest horizon, below which a robot stands."""
CLEAR = 3.0
"""Times the noise that it must travel in that time."""
MAX_MOTION = 0.01
"""Share of that travel in what may be noise as well as motion, where it is no small part of it."""


def demand_fine(log: Log, horizon: float) -> None:
    """Raises InconclusiveError where poses are too far apart for windows of `horizon` s."""
    step = float(np.median(np.diff(log.time)))
    longest = horizon / MIN_STEPS
    if step > longest * (1 + 1e-6):
        raise InconclusiveError(
            f"dynamics: {log.source}: poses every {step:.3g} s are too coarse for windows of "
            f"{horizon:g} s; record one every {longest:.3g} s or oftener"
        )


def demand_motion(real: Log, horizon: float) -> None:
    """Raises InconclusiveError where a robot goes nowhere, or its motion looks like noise."""
    covered = errors.travel(real, horizon)
    measured = noise.of(real)
    if covered < max(MIN_TRAVEL, CLEAR * measured.position):
        raise InconclusiveError(
            f"dynamics: {real.source}: the robot turns or stands ({covered:.2g} m in "
            f"{horizon:g} s, noise {measured.position:.2g} m); leave this drive out"
        )
    if measured.motion > max(MAX_MOTION * covered, 0.5 * measured.position):
        raise InconclusiveError(
            f"dynamics: {real.source}: noise cannot be told from motion ({measured.motion:.2g} m "
            "may be either); record poses oftener"
        )
