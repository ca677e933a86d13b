"""A log at other times."""

from __future__ import annotations

import numpy as np

from s2rtools.logs.contract import Floats, Log


def poses_at(log: Log, times: Floats) -> tuple[Floats, Floats, Floats]:
    """x, y, heading at `times`, by lines between poses; NaN outside the log.

    The heading is continuous, not wrapped.
    """
    columns = (log.x, log.y, np.unwrap(log.heading))
    x, y, heading = (
        np.interp(times, log.time, column, left=np.nan, right=np.nan) for column in columns
    )
    return x, y, heading
