"""A log at other times."""

from __future__ import annotations

import numpy as np

from s2rtools.motion_logs.motion_log import Floats, Log


def poses_at(log: Log, times: Floats, longest: float = np.inf) -> tuple[Floats, Floats, Floats]:
    """x, y, heading at `times`, by lines between poses; the heading is continuous, not wrapped.

    NaN outside the log, and between poses that are more than `longest` s apart.
    """
    columns = (log.x, log.y, np.unwrap(log.heading))
    x, y, heading = (
        np.interp(times, log.time, column, left=np.nan, right=np.nan) for column in columns
    )
    if longest < np.inf:
        right = np.clip(np.searchsorted(log.time, times), 1, log.time.size - 1)
        hole = np.diff(log.time)[right - 1] > longest
        hole &= (times > log.time[right - 1]) & (times < log.time[right])
        x, y, heading = (np.where(hole, np.nan, values) for values in (x, y, heading))
    return x, y, heading
