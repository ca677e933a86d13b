"""Elimination of the start states from the residuals of windows, compiled."""

from __future__ import annotations

import numpy as np

from s2rtools.common.numba_cache import njit
from s2rtools.sysid.simulators.simulator import Floats, Integers


@njit(cache=True)
def eliminate(
    residual: Floats, sensitivity: Floats, first: Integers, precision: Floats, moved: Floats,
    corrections: Floats,
) -> float:  # fmt: skip
    """Minimise `residual` (n, 3), in place, by a change of each window's start state.

    `sensitivity` (n, 3, 5) is the derivative of the residual by the start state. `moved` (w, 5) is
    the distance of the starts from the measured ones, whose `precision` is (5,). `corrections`
    (w, 5) receives the changes to add to the starts. Returns the minimal sum of squares, including
    that of the distance from the measured starts.
    """
    total = 0.0
    for window in range(len(first) - 1):
        a, b = first[window], first[window + 1]
        normal = np.zeros((5, 5))
        right = np.zeros(5)
        for p in range(5):
            normal[p, p] = precision[p]
            right[p] = -precision[p] * moved[window, p]
        for row in range(a, b):
            for channel in range(3):
                value = residual[row, channel]
                for p in range(5):
                    right[p] -= sensitivity[row, channel, p] * value
                    for q in range(p + 1):
                        normal[p, q] += sensitivity[row, channel, p] * sensitivity[row, channel, q]
        change = np.linalg.solve(normal + np.tril(normal, -1).T, right)
        for p in range(5):
            corrections[window, p] = change[p]
            total += precision[p] * (moved[window, p] + change[p]) ** 2
        for row in range(a, b):
            for channel in range(3):
                for p in range(5):
                    residual[row, channel] += sensitivity[row, channel, p] * change[p]
                total += residual[row, channel] * residual[row, channel]
    return total
