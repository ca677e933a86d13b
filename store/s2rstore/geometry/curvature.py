"""How a trajectory bends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.angles import wrap

REACH = 3
STRAIGHT_BELOW = 10.0


def curvature(heading: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heading change in degrees from 3 before to 3 after each instance of one trajectory.

    `heading` (n,) in radians, in recording order. The window is cut at the trajectory's ends.
    """
    n = heading.size
    index = np.arange(n)
    before = np.maximum(index - REACH, 0)
    after = np.minimum(index + REACH, max(n - 1, 0))
    return np.degrees(wrap(heading[after] - heading[before]))
